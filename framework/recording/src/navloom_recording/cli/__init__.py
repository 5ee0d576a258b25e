"""The command `replay`; a live robot is recorded by `record` of navloom-live.

Begin with `replay.py`: unchanged, with another plugin in one role, or republished for tools.
"""
