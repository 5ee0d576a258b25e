"""Sound plugins of unusual kinds, which every check must let pass."""
