"""People and other bodies that move in the ground truth. Only metrics read them, never a plugin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from navloom.messages import Bodies

__all__ = ["MovingBodies", "moving_bodies"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MovingBodies:
    """Bodies that move, at the times of a trail.

    Attributes:
        places, velocities: (n, k, 2) centre, m, and velocity, m/s, of each of k bodies at each of n times, map frame;
            NaN while it is absent.
        radii: (k,) of the disc that holds it, m.
    """

    places: Floats = field(default_factory=lambda: np.empty((0, 0, 2)))
    velocities: Floats = field(default_factory=lambda: np.empty((0, 0, 2)))
    radii: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def are_there(self) -> bool:
        """Whether there is any body at any time."""
        return bool(np.isfinite(self.places).any())


def moving_bodies(messages: Sequence[Bodies], time: Floats) -> MovingBodies:
    """The bodies that the simulated world tells of, without the robots, at some times, (n,) s.

    Args:
        messages: By increasing stamp; none where nothing moves.
        time: At each, the newest message counts.
    """
    columns: dict[str, int] = {}
    for message in messages:
        for name in message.names[: len(message.names) - message.robots]:
            columns.setdefault(name, len(columns))
    places = np.full((len(time), len(columns), 2), np.nan)
    velocities, (radii, middles) = places.copy(), np.zeros((2, len(columns)))
    stamps = np.array([message.stamp_ns for message in messages], dtype=np.int64)
    rows = np.searchsorted(stamps, np.round(1e9 * time).astype(np.int64), side="right") - 1
    for row, index in enumerate(rows.tolist()):
        if index < 0 or not columns:
            continue
        message = messages[index]
        count = len(message.names) - message.robots
        own = [columns[name] for name in message.names[:count]]
        places[row, own], velocities[row, own] = message.poses[:count, :2], message.velocities[:count, :2]
        owners = message.parts[:, 0].astype(np.int64)
        away = np.hypot(*(message.parts[:, 1:3] - message.poses[owners, :2]).T)
        sizes = np.hypot(message.parts[:, 3], message.parts[:, 4])
        of_actor = owners < count
        columns_of = np.array(own, dtype=np.int64)[owners[of_actor]]
        np.maximum.at(radii, columns_of, (away + sizes)[of_actor])
        np.maximum.at(middles, columns_of, np.where(away < 1e-6, sizes, 0.0)[of_actor])
    # Of a person the trunk: the feet swing beyond it.
    return MovingBodies(places, velocities, np.where(middles > 0.0, middles, radii))
