"""The framework's own decisions, as pure functions and small state machines: no I/O, no clock, no node.

Begin with `goal_machine.py`, a goal from request to result, and `command_gate.py`, the last word before the wheels:
who drives, whether commands and sensors are fresh, and how fast.
`trajectory.py` turns a path into a trajectory, `handover.py` says when the avoider takes over, and
`collision_monitor.py` with its `monitor_*` files checks each command. Time and messages are handed in.
"""
