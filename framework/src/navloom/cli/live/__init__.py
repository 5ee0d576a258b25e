"""Commands that start a live robot, act on it and look into it."""
