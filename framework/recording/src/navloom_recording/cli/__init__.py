"""Commands on recordings: `record` and `replay`, one file each.

Begin with `replay.py`: unchanged, with another plugin in one role, or republished for tools.
"""
