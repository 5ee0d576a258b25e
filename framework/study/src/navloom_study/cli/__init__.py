"""Commands on studies: `compare` and `report`, one file each.

Begin with `compare.py`: options to a `Study`, progress while it runs, and tables at its end.
"""
