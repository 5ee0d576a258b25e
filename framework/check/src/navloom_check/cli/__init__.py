"""The command `check`, and `plugins new` with its templates.

Begin with `check.py`.
"""
