"""`navloom ros serve`: a live robot of navloom as ROS tools see and drive it."""
