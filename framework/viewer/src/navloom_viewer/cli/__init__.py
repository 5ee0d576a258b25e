"""The command `view`: shows a live robot or a recording.

Begin with `view.py`.
"""
