"""What localizers and mappers of planar scans share: the field of a map, beams, fits, sight, and search for a pose.

Begin with `field.py`, the distance to the walls of a map; `matching.py` fits a scan to it. All work on plain arrays.
"""
