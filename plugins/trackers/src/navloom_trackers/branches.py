"""Branches of a trajectory, each along its way: a robot that drives backwards is one that drives forwards and heads the
other way, so that each law follows both.

A trajectory is an array (n, 6) of arc length, m, x, y, m, heading of base, rad, curvature, 1/m, and speed, m/s, < 0
backwards. At a cusp, two samples have the same place and arc length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Branch", "branch_at", "branches_of"]

Floats = NDArray[np.float64]


class Branch(NamedTuple):
    """A part of a trajectory between cusps.

    Attributes:
        begin, end: Arc length at its ends, m.
        direction: 1 forwards, -1 backwards.
        samples: (n, 6) along the way: arc length from 0, heading in the direction of driving, speed > 0. Read-only.
    """

    begin: float
    end: float
    direction: float
    samples: Floats


def branches_of(samples: Floats) -> list[Branch]:
    """The branches of a trajectory (n, 6); one that has only one, forwards, keeps its samples."""
    cusps = np.flatnonzero(np.diff(samples[:, 0]) <= 0.0) + 1
    if not len(cusps) and samples[0, 5] > 0.0:
        return [Branch(0.0, float(samples[-1, 0]), 1.0, samples)]
    branches = []
    for part in np.split(samples, cusps):
        along, direction = part.copy(), math.copysign(1.0, part[0, 5])
        along[:, 0] -= part[0, 0]
        if direction < 0.0:
            along[:, 3] = along[:, 3] % math.tau - math.pi  # half a turn more, in [-π, π)
            along[:, 4:] *= -1.0
        along.flags.writeable = False
        branches.append(Branch(float(part[0, 0]), float(part[-1, 0]), direction, along))
    return branches


def branch_at(branches: Sequence[Branch], progress: float, direction: float) -> Branch:
    """The branch at an arc length, m; at a cusp, the direction, 1 or -1, tells which of two."""
    on = (branch for branch in branches if branch.direction == direction and progress <= branch.end + 1e-9)
    return next(on, branches[-1])
