"""People and other bodies that move in the ground truth. Only metrics read them, never a plugin."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.solids import centre_at, is_present
from navloom.geometry.world import Box, Obstacle, World

__all__ = ["MovingBodies", "moving_bodies"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MovingBodies:
    """Bodies that move, at the times of a trail.

    Attributes:
        time: (n,) s, increasing.
        places: (n, k, 2) centre of each of k bodies, m, map frame; NaN while it is absent.
        radii: (k,) of the disc that holds it, m.
    """

    time: Floats = field(default_factory=lambda: np.empty(0))
    places: Floats = field(default_factory=lambda: np.empty((0, 0, 2)))
    radii: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def are_there(self) -> bool:
        """Whether there is any body at any time."""
        return bool(np.isfinite(self.places).any())

    @cached_property
    def velocities(self) -> Floats:
        """(n, k, 2) m/s, map frame: central differences; NaN next to where a body is absent."""
        if len(self.time) < 2:
            return np.zeros_like(self.places)
        return np.asarray(np.gradient(self.places, self.time, axis=0))


def moving_bodies(world: World | None, time: Floats) -> MovingBodies:
    """The bodies of a world that move, at some times, (n,) s.

    A box that appears after the first sweep counts as absent: when that ends is not known here.
    """
    moving = [] if world is None else [one for one in world.obstacles if one.waypoints]
    absent = (math.nan, math.nan)
    places = [[centre_at(one, t) if is_present(one, t, False) else absent for one in moving] for t in time.tolist()]
    return MovingBodies(
        time, np.array(places).reshape(len(time), len(moving), 2), np.array([_radius(one) for one in moving])
    )


def _radius(obstacle: Obstacle) -> float:
    if isinstance(obstacle, Box):
        return 0.5 * math.hypot(obstacle.x[1] - obstacle.x[0], obstacle.y[1] - obstacle.y[0])
    return obstacle.radius
