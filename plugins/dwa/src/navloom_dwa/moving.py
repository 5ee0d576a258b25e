"""Tracked bodies along an arc or a roll-out: where they will be, how near the robot may come, and what that costs."""

from __future__ import annotations

import math

import numpy as np
from navloom_avoidance.bodies import TrackedBodies
from navloom_avoidance.points import TOUCH
from numba import njit
from numpy.typing import NDArray

from navloom_dwa.critics import contact_nearness
from navloom_dwa.objective import arc_pose
from navloom_dwa.rollout import reach_of

Floats = NDArray[np.float64]
MOST = 16
"""Bodies that count: the nearest."""
BODY_SPEED = 2.0
"""Speed, m/s: bodies so far away that none this fast meets the robot within the horizon do not count."""
UNSURE = 0.6
"""Most that the uncertainty of a place adds to the width over which its nearness costs, m."""
NO_BODIES_AHEAD = np.zeros((0, 0, 5))


def bodies_ahead(
    bodies: TrackedBodies, pose: tuple[float, float, float], times: Floats, edges: Floats, margin: float, soft: float,
    sigmas: float, headway: float = 0.0,
) -> Floats:  # fmt: skip
    """Bodies at constant velocity, with a covariance that grows, in the steps of a roll-out.

    A body that is nearer than its margin may stay as near: the robot may move away, but not come nearer.

    Args:
        bodies: Now, pose frame. pose: x, y, m, heading, rad, of the base.
        times: (steps,) time of each step from now, s.
        edges: Half planes of the footprint. margin: Between footprint and body, m. soft: Width of nearness, m.
        sigmas: Standard deviations of a place that widen `soft`.
        headway: Time for which a body's speed widens `soft`, s: it may turn at any moment.

    Returns:
        (steps, n, 5): x, y, m, base frame now; distance beyond the sides of the footprint that is a collision, m;
        width over which nearness falls to 0, m; square of the distance of its centre from which it does not count, m².
    """
    if not len(bodies.radii):
        return NO_BODIES_AHEAD
    distances = np.hypot(*(bodies.positions - pose[:2]).T)
    nearest = np.sort(np.argsort(distances, kind="stable")[:MOST])
    near = TrackedBodies(*(values[nearest] for values in bodies))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turned = np.array([[c, -s], [s, c]])
    now = (near.positions - pose[:2]) @ turned
    beyond = (now @ edges[:, :2].T - edges[:, 2]).max(axis=1)
    keep = np.minimum(near.radii + margin, beyond - TOUCH)
    corner = reach_of(edges, 0.0)
    width = soft + headway * np.hypot(near.velocities[:, 0], near.velocities[:, 1])
    found = np.empty((len(times), len(nearest), 5))
    for t, time in enumerate(times):
        wide = width + np.minimum(sigmas * near.after(float(time)).sigmas(), UNSURE)
        found[t, :, :2] = now + time * (near.velocities @ turned)
        found[t, :, 2], found[t, :, 3] = keep, wide
        found[t, :, 4] = (corner + np.maximum(keep, 0.0) + wide) ** 2
    return found


@njit(cache=True, nogil=True)
def gap_to(bodies: Floats, t: int, b: int, x: float, y: float, c: float, s: float, edges: Floats) -> float:
    """Distance of body b in step t beyond what the footprint must keep, m; infinite where it does not count.

    Args:
        bodies: (steps, n, 5) from bodies_ahead(). x, y, c, s: Position of the base, m, cosine and sine of its heading.
        edges: Half planes of the footprint.
    """
    dx, dy = bodies[t, b, 0] - x, bodies[t, b, 1] - y
    if dx * dx + dy * dy >= bodies[t, b, 4]:
        return np.inf
    ahead, left, beyond = c * dx + s * dy, c * dy - s * dx, -np.inf
    for e in range(edges.shape[0]):
        beyond = max(beyond, edges[e, 0] * ahead + edges[e, 1] * left - edges[e, 2])
    return float(beyond - bodies[t, b, 2])


@njit(cache=True, nogil=True)
def score_bodies(
    arcs: Floats, bodies: Floats, times: Floats, edges: Floats, obstacle: float, contact: float, costs: Floats
) -> None:
    """Add the cost of tracked bodies to each velocity of the window: nearness, averaged, and a contact, if one comes.

    Args:
        arcs: (m, 4), from window.sample_arcs(). bodies: (k, n, 5) from bodies_ahead(), n >= 1.
        times: (k,) s, rising, from the first step; the last is the horizon. edges: Half planes of the footprint.
        obstacle, contact: Weights, m. costs: (m, n), added to.
    """
    steps, count, horizon = times.size, costs.shape[1], times[-1]
    for j in range(arcs.shape[0]):
        for i in range(count):
            if costs[j, i] == np.inf:
                continue
            u = arcs[j, 2] + (arcs[j, 3] - arcs[j, 2]) * i / (count - 1)
            total, met = 0.0, horizon
            for t in range(steps):
                x, y, heading = arc_pose(arcs[j, 0] * u, arcs[j, 1] * u, times[t])
                c, s, near = math.cos(heading), math.sin(heading), 0.0
                for b in range(bodies.shape[1]):
                    gap = gap_to(bodies, t, b, x, y, c, s, edges)
                    if gap < 0.0:
                        met = times[t]
                    near = max(near, 1.0 - max(gap, 0.0) / bodies[t, b, 3])
                if met < horizon:
                    total += steps - t
                    break
                total += near
            costs[j, i] += obstacle * total / steps + contact * contact_nearness(met, horizon)
