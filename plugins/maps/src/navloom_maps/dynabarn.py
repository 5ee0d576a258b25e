"""Worlds of the DynaBARN data set (Nair et al. 2022): cylinders that loop along key frames and see nobody.

The file holds: `world` (n,) the worlds' numbers; `radius`, m, and `period_s` of all obstacles, those of the i-th world
from `world_off[i]` up to `world_off[i + 1]`; and `keys` (m, 3) t, s, x, y, m, those of the k-th obstacle from
`key_off[k]` up to `key_off[k + 1]`.

The organisers' conditions: the robot starts at (11, 0) heading along -x and arrives within 1 m of (-9, 0), in 100 s as
in BARN. Their obstacles begin with the simulator, some time before the robot: `@7.5` is 7.5 s.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from navloom import Actor, Body, Course
from navloom.geometry.world import Place, World
from navloom.worlds import WorldError, did_you_mean, file_of, options_of
from numpy.typing import NDArray

from navloom_maps.arrays import WorldArrays

__all__ = ["dynabarn_numbers", "dynabarn_world"]

START, GOAL = Place(11.0, 0.0, math.pi), Place(-9.0, 0.0)
GOAL_TOLERANCE, TIME_LIMIT = 1.0, 100.0
BOUNDS = (-13.0, -13.0, 13.0, 13.0)
HEIGHT = 1.0
"""Of an obstacle, m: above the lasers of the challenge's robot."""
_KEYS = ("linear", "gazebo")
_MOST = 1_000
"""Most obstacles of one world, since each is moved in every tick."""


def dynabarn_world(argument: str, base: Path) -> World:
    """World scheme `dynabarn:F.npz#N@PHASE?keys=linear`: world number N, its obstacles PHASE s into their courses.

    Between key frames the obstacles go straight; `?keys=gazebo` moves them along the spline by which the organisers'
    simulator animates key frames, on which they are faster than the class of their world says.

    Raises:
        WorldError: The file is missing or damaged, an array is missing or has a wrong shape, or there is no such world.
    """
    reference, options = options_of(argument, {"keys": "linear"})
    if options["keys"] not in _KEYS:
        raise WorldError(f"dynabarn:{argument}: keys={options['keys']}; {did_you_mean(options['keys'], _KEYS)}")
    name, sharp, which = reference.rpartition("#")
    number, at, begin = which.partition("@")
    if not sharp or not number.isascii() or not number.isdigit():
        as_in = f"dynabarn:{name or which}#3@7.5"
        raise WorldError(f"dynabarn:{argument}: {number!r} after '#', expected a world's number, as in {as_in}")
    phase = _phase(argument, begin) if at else 0.0
    arrays = WorldArrays(file_of(name, base))
    _, first, last = arrays.span("world", "world_off", number)
    radii, ends = arrays.read("radius", (-1,)), arrays.read("key_off", (-1,)).astype(np.int64)
    if not 0 <= first <= last <= len(radii) or len(ends) != len(radii) + 1:
        raise WorldError(f"{arrays.path}: obstacles {first} to {last} of world {number}, of {len(radii)} radii")
    if last - first > _MOST:
        raise WorldError(f"{arrays.path}: {last - first} obstacles of world {number}, expected at most {_MOST}")
    keys = arrays.read("keys", (-1, 3))
    actors = []
    for k in range(first, last):
        points, radius = keys[ends[k] : ends[k + 1]], float(radii[k])
        _check(arrays, points, radius, k)
        course = Course(
            tuple((t, x, y) for t, x, y in points.tolist()), "gazebo" if options["keys"] == "gazebo" else "linear",
            loops=True, phase=phase,
        )  # fmt: skip
        actors.append(
            Actor(f"obstacle {k - first + 1}", course, Body("disc", 2.0 * radius, 2.0 * radius, (0.0, HEIGHT)))
        )
    return World(
        f"dynabarn:{argument}", start=START, goal=GOAL, bounds=BOUNDS, goal_tolerance=GOAL_TOLERANCE,
        time_limit=TIME_LIMIT, actors=tuple(actors),
    )  # fmt: skip


def dynabarn_numbers(name: str, base: Path) -> list[int]:
    """The numbers of a file's worlds, increasing. Raises WorldError if the file is missing or damaged."""
    numbers: list[int] = WorldArrays(file_of(name, base)).read("world", (-1,)).astype(np.int64).tolist()
    return sorted(numbers)


def _phase(argument: str, text: str) -> float:
    try:
        phase = float(text)
    except ValueError:
        phase = math.nan
    if not 0.0 <= phase <= 1e6:
        raise WorldError(f"dynabarn:{argument}: {text!r} after '@', expected a time from 0, s, as in #3@7.5")
    return phase


def _check(arrays: WorldArrays, points: NDArray[np.float64], radius: float, number: int) -> None:
    rises = len(points) > 1 and points[0, 0] >= 0.0 and bool((np.diff(points[:, 0]) > 0.0).all())
    if not rises or not radius > 0.0:
        raise WorldError(
            f"{arrays.path}: obstacle {number} has {len(points)} key frames and the radius {radius:g}, expected "
            "two or more, at times from 0 that rise, and a radius > 0"
        )
