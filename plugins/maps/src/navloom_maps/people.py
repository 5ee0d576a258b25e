"""Recorded people: tracks of pedestrians that walk through a world and see no robot.

The file holds, for each of its scenes: `SCENE_t` (n,) s, `SCENE_id` (n,) the person's number, and `SCENE_xy` (n, 2) m,
sampled at any interval. A person is there from the first sample to the last, and walks straight in between.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from navloom import Actor, Body, Course
from navloom.geometry.world import World
from navloom.worlds import WorldError, did_you_mean, file_of, options_of

from navloom_maps.arrays import WorldArrays

__all__ = ["people_world"]

_MARGIN = 2.0
"""Room about the tracks within the bounds of the world, m."""
_BODIES: dict[str, Body] = {"legs": Body("legs", 0.44, 0.44, (0.0, 1.75)), "disc": Body("disc", 0.5, 0.5, (0.0, 1.75))}
_MOST = 10_000
"""Most people of one scene, since each is looked up in every tick."""


def people_world(argument: str, base: Path) -> World:
    """World scheme `people:F.npz#SCENE@T0?body=legs`: a scene as recorded from T0 s on.

    It has no start and no goal: the config gives them.

    Raises:
        WorldError: The file is missing or damaged, an array has a wrong shape, or there is no such scene.
    """
    reference, options = options_of(argument, {"body": "legs"})
    if options["body"] not in _BODIES:
        raise WorldError(f"people:{argument}: body={options['body']}; {did_you_mean(options['body'], _BODIES)}")
    name, sharp, which = reference.rpartition("#")
    scene, at, begin = which.partition("@")
    if not sharp or not scene:
        raise WorldError(f"people:{argument}: expected a scene after '#', as in people:{name or which}#hotel@12.5")
    start = _time(argument, begin) if at else 0.0
    arrays = WorldArrays(file_of(name, base))
    if not arrays.has(f"{scene}_t"):
        scenes = [array.removesuffix("_t") for array in arrays.names if array.endswith("_t")]
        raise WorldError(f"{arrays.path}: there is no scene {scene!r}; {did_you_mean(scene, scenes)}")
    times = arrays.read(f"{scene}_t", (-1,))
    people, places = arrays.read(f"{scene}_id", (len(times),)), arrays.read(f"{scene}_xy", (len(times), 2))
    order = np.lexsort((times, people))
    ids, rows = people[order], np.column_stack([times, places])[order]
    cuts = np.flatnonzero(np.diff(ids)) + 1
    actors = []
    for person, samples in zip(
        ids[np.concatenate([[0], cuts])] if len(ids) else (), np.split(rows, cuts), strict=False
    ):
        if not (np.diff(samples[:, 0]) > 0.0).all():
            raise WorldError(f"{arrays.path}: person {person:g} of {scene} has two samples at one time, expected one")
        # One sample says nothing of a way, and who has left before is not met.
        if len(samples) > 1 and samples[-1, 0] >= start:
            course = Course(tuple((t, x, y) for t, x, y in samples.tolist()), leaves=True, phase=start)
            actors.append(Actor(f"person {person:g}", course, _BODIES[options["body"]]))
    if len(actors) > _MOST:
        raise WorldError(f"{arrays.path}: {len(actors)} people in {scene}, expected at most {_MOST}")
    if not actors:
        raise WorldError(f"people:{argument}: nobody is in {scene} from {start:g} s on; it ends at {times.max():g} s")
    low, high = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return World(f"people:{argument}", bounds=bounds, actors=tuple(actors))


def _time(argument: str, text: str) -> float:
    try:
        time = float(text)
    except ValueError:
        time = math.nan
    if not 0.0 <= time <= 1e6:
        raise WorldError(f"people:{argument}: {text!r} after '@', expected a time from 0, s, as in #hotel@12.5")
    return time
