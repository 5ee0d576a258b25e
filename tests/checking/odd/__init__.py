"""Sound plugins of unusual kinds, which must pass every check."""
