"""A tick in a world of the BARN data set, beside ir-sim with the same laser, obstacles and robot in the same run."""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from navloom.config import ConfigError, load_config
from navloom.engine.assembly import lockstep_of
from navloom.engine.build import assemble
from navloom.engine.making import make_plugins
from navloom.engine.system import System
from navloom.geometry.world import Cylinder
from navloom.messages import RangeScan, Twist2D
from navloom.roles import Platform, PlatformInput
from navloom.worlds.barn import barn_numbers

from navloom_benchmarks import irsim as bench_irsim
from navloom_benchmarks.pairs import Block, Child, Effort, Peer, PeerError, Row, paired, timed

__all__ = ["barn", "reference_of", "scene_given"]

CONFIGS = ("building", "explore")
"""Shipped, with planar lasers of their own: one on a known map, one that maps and replans while it drives."""
BODY = "{ length = 0.458, width = 0.416 }"
"""Of the challenge's Jackal with its wheels, m: what contact counts for."""
TURN_RATE = 0.3
"""rad/s of what only simulates: it turns at the start, so that both look at the same place for ever."""
PATIENCE = 300.0
"""s for a block of ir-sim on a machine that is busy."""
INSTALL = "ir-sim is not installed for {python}: pip install ir-sim, or give --irsim PYTHON of one that has it"


def reference_of(text: str, base: Path) -> str:
    """World reference of `F.npz#17`; without a number, the file's first world. Raises WorldError."""
    name, sharp, _ = text.partition("#")
    return f"barn:{text}" if sharp else f"barn:{name}#{barn_numbers(name, base)[0]}"


def barn(effort: Effort, say: Callable[[str], None], reference: str, python: str = sys.executable) -> Iterator[Row]:
    """Ticks of our simulator alone, and of the whole closed loop, beside ticks of ir-sim, which only simulates.

    Args:
        effort: How much.
        say: Progress.
        reference: World `barn:F.npz#17`.
        python: Interpreter that may have ir-sim.
    """
    ticks = effort.size(4, 1)
    for config in CONFIGS:
        say(f"barn: {config} in {reference}")
        system = assemble(load_config(config, [f"world.ref={reference}", f"robot.footprint={BODY}"]))
        make_plugins(system)
        given = scene_given(system)
        laser = f"laser of {given['laser']['beams']} beams, {len(given['cylinders'])} cylinders"
        with tempfile.TemporaryDirectory(prefix="nlb") as folder, ExitStack() as stack:
            peer, ranges = _peer(given, python, ticks, Path(folder), stack)
            if ranges:
                laser += f", scans at the start {1e3 * _apart(system, ranges):.0f} mm apart in the median"
            note = f"{laser}; both simulate only"
            ours = _simulator(system, effort.size(200, 20))
            yield paired(f"BARN tick, simulator ({config})", "ms", ours, peer, effort.rounds, note)
            note = f"{laser}; ours simulates and navigates from start to goal, ir-sim only simulates"
            drive = _drive(system, effort.size(100_000, 50))
            yield paired(f"BARN tick, closed loop ({config})", "ms", drive, peer, effort.rounds, note)


def _peer(given: dict[str, Any], python: str, ticks: int, folder: Path, stack: ExitStack) -> tuple[Peer, list[float]]:
    """ir-sim in this scene, and the ranges that it reads at the start, m."""
    scene = folder / "scene.json"
    scene.write_text(json.dumps(given), "utf-8")
    script = str(Path(bench_irsim.__file__).resolve())
    python = str(Path(python).absolute()) if os.sep in python else python  # the child works in a folder of its own
    try:  # isolated: beside the script lie modules of ours that would pass for the standard library's
        child = stack.enter_context(Child("ir-sim", [python, "-I", script, str(scene)], folder, PATIENCE))
    except PeerError as error:
        lacks = "No module named 'irsim'" in str(error)
        return Peer("ir-sim", absence=INSTALL.format(python=Path(python).name) if lacks else str(error)), []
    return Peer(child.hello["name"], lambda: float(child.ask(ticks)) / ticks), child.hello["ranges"]


def _apart(system: System, ranges: list[float]) -> float:
    """Median difference of a scan at the start to another's ranges, m, over beams for which both have an echo."""
    platform = _platform(system)
    platform.reset()
    still = PlatformInput(Twist2D(0.0, 0.0, 0.0), None, 0)
    (scan,) = (given for given in platform.advance(still).scans.values() if isinstance(given, RangeScan))
    theirs, furthest = np.array(ranges), max(ranges)
    both = np.isfinite(scan.ranges) & (theirs < furthest)
    return float(np.median(np.abs(scan.ranges - theirs)[both]))


def scene_given(system: System) -> dict[str, Any]:
    """What ir-sim is told, as `bench_irsim.scene_of` takes it. Raises ConfigError: not all are cylinders."""
    world = system.world
    if world is None or world.start is None or not all(isinstance(solid, Cylinder) for solid in world.obstacles):
        raise ConfigError("a world of cylinders with a start is needed, as barn:F.npz#17 gives")
    (laser,) = (sensor for sensor in system.sensors if sensor.kind == "laser_2d")
    return {
        "bounds": list(world.bounds),
        "period": system.config.run.period,
        "start": [world.start.x, world.start.y, world.start.heading],
        "footprint": system.robot.footprint.tolist(),
        "laser": {
            "beams": laser.settings["beams"],
            "field_of_view": math.radians(laser.settings["field_of_view_deg"]),
            "range_max": laser.settings["range_max"],
        },
        "cylinders": [[solid.x, solid.y, solid.radius] for solid in world.obstacles if isinstance(solid, Cylinder)],
        "turn_rate": TURN_RATE,
    }


def _platform(system: System) -> Platform:
    plugin = system.plugin("platform", system.config.platform.instance)
    assert isinstance(plugin, Platform)
    return plugin


def _simulator(system: System, ticks: int) -> Block:
    platform = _platform(system)
    period_ns = round(system.config.run.period * 1e9)

    def turn() -> None:
        platform.reset()
        for tick in range(ticks):
            platform.advance(PlatformInput(Twist2D(0.0, 0.0, TURN_RATE), None, tick * period_ns))

    block = timed(turn, 1)
    return lambda: block() / ticks


def _drive(system: System, ticks: int) -> Block:
    """A whole drive, or its first ticks: s of one."""

    def block() -> float:
        make_plugins(system)
        executor, done = lockstep_of(system), []
        spent = timed(lambda: done.append(executor.run(ticks).ticks), 1)()
        return spent / float(done[0])

    return block
