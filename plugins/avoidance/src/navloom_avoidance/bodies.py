"""Tracked bodies: where they will be, how sure that is, and the readings of a laser without them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from navloom_avoidance.beams import Beams

if TYPE_CHECKING:
    from navloom.messages import Tracks

__all__ = ["BODY", "NO_BODIES", "TrackedBodies", "without_bodies"]

Floats = NDArray[np.float64]
BODY = 0.15
"""Echoes up to this far outside a body's disc are of the body, m: legs that step out, and errors of its place."""
FAR = 1.0e6
"""Range of a beam without an echo, m."""


class TrackedBodies(NamedTuple):
    """Tracked bodies at one time, in the pose frame.

    Attributes:
        positions: (n, 2) m. velocities: (n, 2) m/s. radii: (n,) m.
        covariances: (n, 4, 4) of x, y, vx, vy; m², m²/s, m²/s².
    """

    positions: Floats
    velocities: Floats
    radii: Floats
    covariances: Floats

    @classmethod
    def of(cls, tracks: Tracks | None, stamp_ns: int) -> Self:
        """Tracks at a time of the run clock, at constant velocity; none for None."""
        if tracks is None:
            return cls(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 4, 4)))
        return cls(tracks.positions, tracks.velocities, tracks.radii, tracks.covariances).after(
            (stamp_ns - tracks.stamp_ns) * 1e-9
        )

    def after(self, time: float) -> Self:
        """The bodies a time later, s, at constant velocity: P <- F P F', with F = [[1, time], [0, 1]] in each axis."""
        if time == 0.0 or not len(self.radii):
            return self
        step = np.eye(4) + time * np.eye(4, k=2)
        return self._replace(
            positions=self.positions + time * self.velocities, covariances=step @ self.covariances @ step.T
        )

    def sigmas(self) -> Floats:
        """(n,) standard deviation of each place along its larger axis, m."""
        sigmas: Floats = np.sqrt(np.linalg.eigvalsh(self.covariances[:, :2, :2])[:, -1].clip(min=0.0))
        return sigmas

    def within(self, place: tuple[float, float], reach: float) -> Self:
        """Those whose centre is nearer to a place, m, than the reach, m."""
        near = np.hypot(self.positions[:, 0] - place[0], self.positions[:, 1] - place[1]) < reach
        return type(self)(*(values[near] for values in self))


NO_BODIES = TrackedBodies.of(None, 0)


def without_bodies(beams: Beams, pose: tuple[float, float, float], bodies: TrackedBodies) -> Beams:
    """A laser's readings without those of bodies: range 0, which is neither an echo nor free space up to one.

    With them, the places where a body was would count until the laser sees past them.

    Args:
        beams: Readings of a laser. pose: x, y, m, heading, rad, of the base. bodies: At the time of the readings.
    """
    if not len(bodies.radii):
        return beams
    c, s = math.cos(pose[2]), math.sin(pose[2])
    angles, reached = pose[2] + beams.bearings, np.minimum(beams.ranges, FAR)
    x = pose[0] + c * beams.origins[:, 0] - s * beams.origins[:, 1] + reached * np.cos(angles)
    y = pose[1] + s * beams.origins[:, 0] + c * beams.origins[:, 1] + reached * np.sin(angles)
    places, reach = bodies.positions, bodies.radii + BODY
    hits = (x[:, None] - places[:, 0]) ** 2 + (y[:, None] - places[:, 1]) ** 2 < reach**2
    ranges = np.where(hits.any(axis=1), 0.0, beams.ranges)
    ranges.flags.writeable = False
    return beams._replace(ranges=ranges)
