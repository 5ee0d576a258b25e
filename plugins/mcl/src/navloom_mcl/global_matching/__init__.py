"""`global_matching`: a search over the map finds the robot, and scan matching tracks it.

Begin with `supervisor.py`, which decides between the two; `places.py` follows the places that fit meanwhile.
"""
