"""What moves, as a perfect tracker would tell it: for rows that show what is lost by tracking."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navloom_sensors_sim.scanners import Fields, Moment, freeze

if TYPE_CHECKING:
    from navloom_sensors_sim.params import TrueTracksSettings

__all__ = ["TrueTracks"]

Floats = NDArray[np.float64]


class TrueTracks:
    """The true places and velocities of the bodies within reach, hidden ones too; without an error, in every tick."""

    def __init__(
        self, settings: TrueTracksSettings, footprint: Floats, rng: np.random.Generator, period: float
    ) -> None:
        self._reach = settings.reach
        self._numbers: dict[str, int] = {}

    def read(self, moment: Moment) -> Fields:
        """The fields of `Tracks`."""
        bodies: Any = moment.bodies
        if bodies is None:
            none = freeze(np.empty((0, 2)))
            return moment.end_ns, np.empty(0, np.int64), none, none, np.empty((0, 4, 4)), np.empty(0), np.empty(0)
        for name in bodies.names:
            self._numbers.setdefault(name, len(self._numbers) + 1)
        away = bodies.poses[:, :2] - moment.state[:2]
        is_near = np.hypot(away[:, 0], away[:, 1]) < self._reach
        if moment.own_body >= 0:
            is_near[moment.own_body] = False
        numbers = np.array([self._numbers[name] for name in bodies.names], dtype=np.int64)
        own = np.flatnonzero(is_near)
        own = own[np.argsort(numbers[own])]
        nothing = np.zeros((len(own), 4, 4))
        places, speeds = bodies.poses[own, :2].copy(), bodies.velocities[own, :2].copy()
        return moment.end_ns, numbers[own], places, speeds, nothing, radii_of(bodies)[own], np.zeros(len(own))


def radii_of(bodies: Any) -> Floats:
    """(n,) radius of the disc round the place of each body that holds it, m; `bodies`: navloom's `Bodies`.

    Of a person that is the trunk: the feet swing beyond it and back, and the radius must not.
    """
    radii, middles = np.zeros((2, len(bodies.names)))
    owners = bodies.parts[:, 0].astype(np.int64)
    away = np.hypot(*(bodies.parts[:, 1:3] - bodies.poses[owners, :2]).T)
    sizes = np.hypot(bodies.parts[:, 3], bodies.parts[:, 4])
    np.maximum.at(radii, owners, away + sizes)
    np.maximum.at(middles, owners, np.where(away < 1e-6, sizes, 0.0))
    return np.where(middles > 0.0, middles, radii)
