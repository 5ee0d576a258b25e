"""What several avoiders share: beams, certainty windows, clearance, motors, progress and traps. All on plain arrays."""
