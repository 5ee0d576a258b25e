"""Recorded people: tracks of pedestrians that walk through a world and see no robot.

The file holds, for each of its scenes: `SCENE_t` (n,) s, `SCENE_id` (n,) the person's number, and `SCENE_xy` (n, 2) m,
sampled at any interval. A person walks straight from sample to sample, and in `lead` seconds to the first and from the
last: a recording begins and ends where its camera sees, and nobody comes out of nothing beside a robot.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from navloom import Actor, Body, Course
from navloom.geometry.world import World
from navloom.worlds import WorldError, did_you_mean, file_of, options_of
from numpy.typing import NDArray

from navloom_maps.arrays import WorldArrays

__all__ = ["people_world"]

_MARGIN = 2.0
"""Room about the tracks within the bounds of the world, m."""
_PACE = 1.0
"""Time from which the velocity before the first and after the last sample is taken, s: about two steps."""
_BODIES: dict[str, Body] = {"legs": Body("legs", 0.44, 0.44, (0.0, 1.75)), "disc": Body("disc", 0.5, 0.5, (0.0, 1.75))}
_MOST = 10_000
"""Most people of one scene, since each is looked up in every tick."""


def people_world(argument: str, base: Path) -> World:
    """World scheme `people:F.npz#SCENE@T0?body=legs&lead=4`: a scene as recorded from T0 s on.

    For `lead` seconds, people walk to their first and from their last sample. It has no start and no goal: the config
    gives them.

    Raises:
        WorldError: The file is missing or damaged, an array has a wrong shape, or there is no such scene.
    """
    reference, options = options_of(argument, {"body": "legs", "lead": "4"})
    if options["body"] not in _BODIES:
        raise WorldError(f"people:{argument}: body={options['body']}; {did_you_mean(options['body'], _BODIES)}")
    name, sharp, which = reference.rpartition("#")
    scene, at, begin = which.partition("@")
    if not sharp or not scene:
        raise WorldError(f"people:{argument}: expected a scene after '#', as in people:{name or which}#hotel@12.5")
    start = _time(argument, begin, "after '@'", "#hotel@12.5") if at else 0.0
    lead = _time(argument, options["lead"], "for lead", "?lead=4")
    arrays = WorldArrays(file_of(name, base))
    if not arrays.has(f"{scene}_t"):
        scenes = [array.removesuffix("_t") for array in arrays.names if array.endswith("_t")]
        raise WorldError(f"{arrays.path}: there is no scene {scene!r}; {did_you_mean(scene, scenes)}")
    times = arrays.read(f"{scene}_t", (-1,))
    people, places = arrays.read(f"{scene}_id", (len(times),)), arrays.read(f"{scene}_xy", (len(times), 2))
    order = np.lexsort((times, people))
    ids, rows = people[order], np.column_stack([times, places])[order]
    cuts = np.flatnonzero(np.diff(ids)) + 1
    actors, walked = [], []
    for person, samples in zip(
        ids[np.concatenate([[0], cuts])] if len(ids) else (), np.split(rows, cuts), strict=False
    ):
        if not (np.diff(samples[:, 0]) > 0.0).all():
            raise WorldError(f"{arrays.path}: person {person:g} of {scene} has two samples at one time, expected one")
        # One sample says nothing of a way, and who has left before is not met.
        if len(samples) > 1 and samples[-1, 0] + lead >= start:
            points = _with_leads(samples, lead) if lead > 0.0 else samples
            course = Course(tuple((t, x, y) for t, x, y in points.tolist()), leaves=True, phase=start)
            actors.append(Actor(f"person {person:g}", course, _BODIES[options["body"]]))
            walked.append(points[:, 1:])
    if len(actors) > _MOST:
        raise WorldError(f"{arrays.path}: {len(actors)} people in {scene}, expected at most {_MOST}")
    if not actors:
        raise WorldError(f"people:{argument}: nobody is in {scene} from {start:g} s on; it ends at {times.max():g} s")
    everywhere = np.vstack([*walked, places])
    low, high = everywhere.min(axis=0) - _MARGIN, everywhere.max(axis=0) + _MARGIN
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return World(f"people:{argument}", bounds=bounds, actors=tuple(actors))


def _with_leads(samples: NDArray[np.float64], lead: float) -> NDArray[np.float64]:
    """Samples (n, 3) of time, s, and place, m, with one a time, s, before the first and one after the last."""
    found = []
    for end, way in ((samples[0], samples), (samples[-1], samples[::-1])):
        near = way[np.abs(way[:, 0] - end[0]) <= max(_PACE, abs(way[1, 0] - end[0]))][-1]
        velocity = (near[1:] - end[1:]) / (near[0] - end[0])
        passed = math.copysign(lead, end[0] - near[0])
        found.append(np.array([end[0] + passed, *(end[1:] + passed * velocity)]))
    return np.vstack([found[0], samples, found[1]])


def _time(argument: str, text: str, where: str, such_as: str) -> float:
    try:
        time = float(text)
    except ValueError:
        time = math.nan
    if not 0.0 <= time <= 1e6:
        raise WorldError(f"people:{argument}: {text!r} {where}, expected a time from 0, s, as in {such_as}")
    return time
