"""The entry `barn` of `navloom bench`: a tick in a BARN world, compared with ir-sim in the same scene.

Laser, obstacles and robot are the same. ir-sim runs in a child process (`irsim`), perhaps under another interpreter.
"""

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
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import lockstep_of
from navloom.engine.plugin_factory import make_plugins
from navloom.engine.system import System
from navloom.geometry.world import Cylinder
from navloom.messages import RangeScan, Twist2D
from navloom.roles import Platform, PlatformInput
from navloom_maps.barn import barn_numbers

from navloom_benchmarks import irsim as bench_irsim
from navloom_benchmarks.pairs import Block, Child, Effort, Peer, PeerError, Row, paired, timed

__all__ = ["barn", "reference_of", "scene_given"]

CONFIGS = ("building", "explore")
"""Shipped configs that are measured; each has a planar laser. The first has a known map, the second builds its map."""
BODY = "{ length = 0.458, width = 0.416 }"
"""Footprint of the BARN challenge's Jackal with its wheels, m, for contacts."""
TURN_RATE = 0.3
"""Turn rate without navigation, rad/s: the robot turns at its start, so that both simulators see the same place."""
PATIENCE = 300.0
"""Longest wait for a block of ir-sim on a busy machine, s."""
INSTALL = "ir-sim is not installed for {python}: pip install ir-sim, or give --irsim PYTHON of one that has it"


def reference_of(text: str, base: Path) -> str:
    """World reference for `F.npz#17`; without a number, for the file's first world. Raises WorldError."""
    name, sharp, _ = text.partition("#")
    return f"barn:{text}" if sharp else f"barn:{name}#{barn_numbers(name, base)[0]}"


def barn(effort: Effort, say: Callable[[str], None], reference: str, python: str = sys.executable) -> Iterator[Row]:
    """Compare a tick of our simulator, and of the whole closed loop, with a tick of ir-sim, which only simulates.

    Args:
        effort: Number of rounds and ticks.
        say: Receives a line of progress.
        reference: World reference, as `barn:F.npz#17`.
        python: Interpreter in which ir-sim is sought.
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
    """ir-sim in this scene, and its ranges at the start, m; without ir-sim, an absent peer and no ranges."""
    scene = folder / "scene.json"
    scene.write_text(json.dumps(given), "utf-8")
    script = str(Path(bench_irsim.__file__).resolve())
    python = str(Path(python).absolute()) if os.sep in python else python  # the child has another working directory
    try:  # -I: the script, irsim.py, must not shadow the package irsim
        child = stack.enter_context(Child("ir-sim", [python, "-I", script, str(scene)], folder, PATIENCE))
    except PeerError as error:
        lacks = "No module named 'irsim'" in str(error)
        return Peer("ir-sim", absence=INSTALL.format(python=Path(python).name) if lacks else str(error)), []
    return Peer(child.hello["name"], lambda: float(child.ask(ticks)) / ticks), child.hello["ranges"]


def _apart(system: System, ranges: list[float]) -> float:
    """Median difference between our scan at the start and `ranges`, m, over beams where both have an echo."""
    platform = _platform(system)
    platform.reset()
    still = PlatformInput(Twist2D(0.0, 0.0, 0.0), None, 0)
    (scan,) = (given for given in platform.advance(still).scans.values() if isinstance(given, RangeScan))
    theirs, furthest = np.array(ranges), max(ranges)
    both = np.isfinite(scan.ranges) & (theirs < furthest)
    return float(np.median(np.abs(scan.ranges - theirs)[both]))


def scene_given(system: System) -> dict[str, Any]:
    """The scene for ir-sim, the argument of `irsim.scene_of`.

    Raises:
        ConfigError: The world has no start, or an obstacle that is not a cylinder.
    """
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
    """A block that drives at most `ticks` ticks and returns the time of one, s."""

    def block() -> float:
        make_plugins(system)
        executor, done = lockstep_of(system), []
        spent = timed(lambda: done.append(executor.run(ticks).ticks), 1)()
        return spent / float(done[0])

    return block
