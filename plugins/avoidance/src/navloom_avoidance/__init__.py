"""Common parts of avoiders: beams, certainty windows, clearance, motors, progress and traps, on plain arrays."""
