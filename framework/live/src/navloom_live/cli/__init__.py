"""Commands that start a live robot, control it and inspect it, one file each.

Begin with `up.py`. They enter by the entry points `command.NAME`, like commands of other distributions.
"""
