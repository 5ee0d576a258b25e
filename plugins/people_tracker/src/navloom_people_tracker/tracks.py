"""The table of tracks."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from navloom_people_tracker.bodies import Bodies
from navloom_people_tracker.circles import RADIUS_SIGMA

__all__ = ["MARKS", "Tracks", "begun"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

MARKS = 12
"""Earlier places of a track that are kept."""
START_SPEED = 1.0
"""Standard deviation of the speed of a new track, m/s: that of a walking person."""


@dataclass
class Tracks:
    """Tracks, one row each.

    Attributes:
        ids: (n,) number of each; 0 while it is tentative.
        means, covariances: (n, 4) x, y, m, vx, vy, m/s, and (n, 4, 4), odometry frame.
        chances: (n, 2) of the models, that a body goes on and that it turns.
        modes, mode_covariances: (n, 2, 4) and (n, 2, 4, 4) the states by each of them.
        places: (n, 2) where each was seen last, m.
        radii, radius_sigmas: (n,) m, and its standard deviation, m.
        born, seen: (n,) time of the first and of the last echo, s.
        evidence: (n,) for how long it was seen to move within the last half second, s.
        is_moving: (n,) whether it moves.
        is_in_free: (n,) whether a map has nothing at the place where it was seen last.
        through, beside: (n,) for how long beams passed through its place, or ended there at something else, s.
        marks: (n, MARKS, 7) x, y of earlier echoes, x, y of the centre then, m, the time, s, and the way, m, and the
            angles, rad, of the robot up to then; NaN for none.
    """

    ids: Ints
    means: Floats
    covariances: Floats
    chances: Floats
    modes: Floats
    mode_covariances: Floats
    places: Floats
    radii: Floats
    radius_sigmas: Floats
    born: Floats
    seen: Floats
    evidence: Floats
    is_moving: Bools
    is_in_free: Bools
    through: Floats
    beside: Floats
    marks: Floats

    def rows(self, kept: Bools | Ints) -> Tracks:
        """Some of the tracks."""
        return Tracks(*[getattr(self, field.name)[kept] for field in fields(self)])

    def joined(self, others: Tracks) -> Tracks:
        """These tracks, then others."""
        names = [field.name for field in fields(self)]
        return Tracks(*[np.concatenate([getattr(self, name), getattr(others, name)]) for name in names])


def begun(bodies: Bodies, time: float) -> Tracks:
    """Tentative tracks of bodies that are seen first at a time, s."""
    count = len(bodies.places)
    covariances = np.zeros((count, 4, 4))
    radius_sigmas = np.minimum(bodies.radius_sigmas, RADIUS_SIGMA)
    covariances[:, :2, :2] = bodies.centred(bodies.radii, radius_sigmas)[1]
    covariances[:, [2, 3], [2, 3]] = START_SPEED**2
    means = np.column_stack([bodies.places, np.zeros((count, 2))])
    return Tracks(
        ids=np.zeros(count, np.int64),
        means=means,
        covariances=covariances,
        chances=np.tile([0.8, 0.2], (count, 1)),
        modes=np.repeat(means[:, None], 2, axis=1),
        mode_covariances=np.repeat(covariances[:, None], 2, axis=1),
        places=bodies.places.copy(),
        radii=bodies.radii.copy(),
        radius_sigmas=radius_sigmas,
        born=np.full(count, time),
        seen=np.full(count, time),
        evidence=np.zeros(count),
        is_moving=np.zeros(count, np.bool_),
        is_in_free=bodies.is_in_free.copy(),
        through=np.zeros(count),
        beside=np.zeros(count),
        marks=np.full((count, MARKS, 7), np.nan),
    )
