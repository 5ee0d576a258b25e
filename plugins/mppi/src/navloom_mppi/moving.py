"""Tracked bodies along a roll-out: where they will be in each step, and how near the robot may come."""

from __future__ import annotations

import math

import numpy as np
from navloom_avoidance.bodies import Bodies
from navloom_avoidance.points import TOUCH
from navloom_dwa.rollout import reach_of
from numpy.typing import NDArray

Floats = NDArray[np.float64]
MOST = 16
"""Bodies that count: the nearest."""
UNSURE = 0.6
"""Most that the uncertainty of a place adds to the width over which its nearness costs, m."""
NO_BODIES_AHEAD = np.zeros((0, 0, 5))


def bodies_ahead(
    bodies: Bodies, pose: tuple[float, float, float], times: Floats, edges: Floats, margin: float, soft: float,
    sigmas: float,
) -> Floats:  # fmt: skip
    """Bodies at constant velocity, with a covariance that grows, in the steps of a roll-out.

    A body that is nearer than its margin may stay as near: the robot may move away, but not come nearer.

    Args:
        bodies: Now, pose frame. pose: x, y, m, heading, rad, of the base.
        times: (steps,) time of each step from now, s.
        edges: Half planes of the footprint. margin: Between footprint and body, m. soft: Width of nearness, m.
        sigmas: Standard deviations of a place that widen `soft`.

    Returns:
        (steps, n, 5): x, y, m, base frame now; distance beyond the sides of the footprint that is a collision, m;
        width over which nearness falls to 0, m; square of the distance of its centre from which it does not count, m².
    """
    if not len(bodies.radii):
        return NO_BODIES_AHEAD
    distances = np.hypot(*(bodies.positions - pose[:2]).T)
    nearest = np.sort(np.argsort(distances, kind="stable")[:MOST])
    near = Bodies(*(values[nearest] for values in bodies))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turned = np.array([[c, -s], [s, c]])
    now = (near.positions - pose[:2]) @ turned
    beyond = (now @ edges[:, :2].T - edges[:, 2]).max(axis=1)
    keep = np.minimum(near.radii + margin, beyond - TOUCH)
    corner = reach_of(edges, 0.0)
    found = np.empty((len(times), len(nearest), 5))
    for t, time in enumerate(times):
        wide = soft + np.minimum(sigmas * near.after(float(time)).sigmas(), UNSURE)
        found[t, :, :2] = now + time * (near.velocities @ turned)
        found[t, :, 2], found[t, :, 3] = keep, wide
        found[t, :, 4] = (corner + np.maximum(keep, 0.0) + wide) ** 2
    return found
