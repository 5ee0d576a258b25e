"""Drives of a live robot from start to end: `navloom up`, and the episodes of live studies."""
