"""What avoiders share, public: beams, certainty windows, histograms, clearance, motors, progress and traps.

Begin with `method.py`, the base of an avoider that decides once a tick; `certainty.py` is the grid around the robot.
All modules work on plain arrays; equations name their source (Hoang et al. 2013, Borenstein & Koren).
`navloom.avoidance` stays importable as an alias of this package.
"""
