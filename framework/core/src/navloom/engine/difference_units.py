"""Units of the differences between two instances, and which differences count."""

from __future__ import annotations

__all__ = ["TOLERANCES", "UNITS"]

UNITS = {
    "vx": "m/s", "vy": "m/s", "wz": "rad/s", "found": "1", "length": "m", "hausdorff": "m", "cells": "1",
    "occupied": "1", "distance": "m", "angle": "rad", "unequal": "1",
}  # fmt: skip
"""Unit of each difference, by name."""
TOLERANCES = {
    "vx": 0.01, "vy": 0.01, "wz": 0.01, "found": 0.5, "length": 0.05, "hausdorff": 0.10, "cells": 0.001,
    "occupied": 0.01, "distance": 0.01, "angle": 0.01, "unequal": 0.5,
}  # fmt: skip
"""Largest difference that counts as equal, in its unit: above rounding errors, below a visible effect."""
