"""Commands on studies and on one sweep: `compare`, `report` and `map`, one file each.

Begin with `compare.py`: options to a `Study`, progress while it runs, and tables at its end.
"""
