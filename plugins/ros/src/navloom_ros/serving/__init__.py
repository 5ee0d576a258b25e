"""`navloom ros serve`: shows a live navloom robot on a ROS network, and takes goals from there."""
