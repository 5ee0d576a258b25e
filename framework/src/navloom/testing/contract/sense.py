"""What answers say in numbers, and what a plugin leaves changed in its process."""

from __future__ import annotations

import decimal
import gc
import math
import os
import random
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from navloom.messages import Path, RangeScan
from navloom.testing.bench import Bench, alike
from navloom.testing.checks import check
from navloom.testing.contract.kinds import PLAYED
from navloom.testing.findings import Finding

__all__ = ["CHECKS"]

SHORTER = 0.98
"""Least ratio of a path's length to that of its points: pruning makes points shorter, never longer."""
FULL_TURN = math.tau + 1e-6


def _answers(bench: Bench) -> Iterator[tuple[Any, Any, int, Any]]:
    """Scene, input, step and answer of every sound scene."""
    for scene in bench.sound():
        with alike():
            player = bench.player(scene)
            for step, given in enumerate(scene.inputs):
                yield scene, given, step, player.step(given)


@check("contract", {"planner"}, "A path's length is that of its points, or more where they were pruned.")
def path_length(bench: Bench) -> Iterator[Finding]:
    """In m."""
    for scene, given, step, answer in _answers(bench):
        if not isinstance(answer, Path):
            continue
        along = float(np.hypot(*np.diff(answer.points, axis=0).T).sum())
        slack = 3.0 * given.map.grid.resolution if answer.traversable is None else 3.0 * answer.traversable.resolution
        if answer.length < SHORTER * along - slack:
            yield Finding(
                f"gives a path of length {answer.length:.2f} m whose points are {along:.2f} m long",
                "the length of the path as planned, m", given=bench.at(scene, step), scene=scene.name,
            )  # fmt: skip
            return


@check("contract", {"platform"}, "Bearings and half angles of scans are in rad, and beams begin within 10 m of base.")
def scan_geometry(bench: Bench) -> Iterator[Finding]:
    """What no sensor can have."""
    for scene, _, step, answer in _answers(bench):
        for name, scan in answer.scans.items():
            if not isinstance(scan, RangeScan) or not scan.ranges.size:
                continue
            widest = max(float(np.abs(scan.bearings).max()), float(scan.half_angles.max()))
            farthest = float(np.abs(scan.origins).max())
            if widest > FULL_TURN:
                said, expected = f"gives a scan of {name!r} with an angle of {widest:.3g} rad", "rad, not degrees"
            elif farthest > 10.0:
                said, expected = f"gives a scan of {name!r} whose beams begin {farthest:.3g} m from base", "m, not mm"
            else:
                continue
            yield Finding(said, expected, given=bench.at(scene, step), scene=scene.name)
            return


_LOOKS: dict[str, Callable[[], Any]] = {
    "random": lambda: hash(random.getstate()),
    "numpy.random": lambda: hash(np.random.get_state()[1].tobytes()),  # type: ignore[index]  # noqa: NPY002
    "numpy.errstate": lambda: tuple(sorted(np.geterr().items())),
    "the working directory": os.getcwd,
    "the environment": lambda: tuple(sorted(os.environ.items())),
    "the recursion limit": sys.getrecursionlimit,
    "the garbage collector": lambda: (gc.isenabled(), gc.get_threshold()),
    "the decimal context": lambda: decimal.getcontext().prec,
    "the default timeout of sockets": socket.getdefaulttimeout,
    "signal handlers": lambda: tuple(str(signal.getsignal(one)) for one in (signal.SIGINT, signal.SIGTERM)),
}
"""What a process has but one of, and how it is looked at."""


@check("contract", PLAYED, "A step leaves what the process has but one of as it is: random seeds, environment, folder.")
def global_state(bench: Bench) -> Iterator[Finding]:
    """Other plugins of the process, and the framework, have the same."""
    scene = bench.sound()[0]
    with alike():
        before = {name: look() for name, look in _LOOKS.items()}
        player = bench.player(scene)
        for given in scene.inputs:
            player.step(given)
        changed = [name for name, look in _LOOKS.items() if look() != before[name]]
    if changed:
        yield Finding(
            f"changes {', '.join(changed)}", "context.stream(name) for random numbers, and nothing else that is global",
            given=f"scene {scene.name!r}", scene=scene.name,
        )  # fmt: skip


CHECKS = (path_length, scan_geometry, global_state)
