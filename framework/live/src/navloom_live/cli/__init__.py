"""Commands that start a live robot, control it and inspect it."""
