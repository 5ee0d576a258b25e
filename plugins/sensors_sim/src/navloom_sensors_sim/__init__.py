"""A simulated robot for navloom: worlds, lasers, sonars, odometry and contact."""
