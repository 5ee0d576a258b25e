"""Whole drives by reading: shape of the path, turn in place, the avoider as printed and robust, and its range."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from navloom_improved_vfh.params import PRINTED, ImprovedVfhParams
from numpy.typing import NDArray

from navloom_hoang2013.errata import ROOM, Variant
from navloom_hoang2013.runs import Drive, away_from, box, drive
from navloom_hoang2013.seeds import Tally, driven

__all__ = ["AVOIDERS", "OFFS", "Door", "DriveReadings", "Reach", "Turn", "reach_of", "readings_of", "steps_of_readings"]

Floats = NDArray[np.float64]
SHAPES = (
    ("pruned and rounded", "navigation.path_shape=rounded"),
    ("along the cells", "navigation.path_shape=as_planned"),
)
OFFS = (30, 60, 90, 120, 135, 180)
"""Headings at the start, degrees off the first leg."""
IN_PLACE = ((60, "turn in place above 60°"), (180, "never (the paper)"))
OPEN = ("world.ref=empty", "navigation.goal={x=0,y=7.6}", "platform.noise=false")
"""Settings of a drive straight from S to D without a room: the laser sees only what is ahead."""
BLIND = ("navigation.handover=never", "gate.monitor=false")
"""Settings that keep the avoider out, so that an obstacle is approached from afar to contact."""
FROM_AFAR = ("navigation.start={x=-1.2,y=-1.4,heading_deg=59.04}", "navigation.goal={x=2.4,y=4.6}", *BLIND)
"""Settings of a straight drive from 4.5 m before O into O."""
WIDE = "avoider.window=81"
"""A window of 81 cells of 0.1 m reaches 4 m to the sides."""


def _preset(name: str) -> str:
    return f"avoider.plugin=improved_vfh@{name}"


def _printed_keys() -> tuple[str, ...]:
    """Each setting in which the printed avoider differs from the robust one."""
    default = ImprovedVfhParams()
    return tuple(
        f"avoider.{key}={str(value).lower() if isinstance(value, bool) else value}"
        for key, value in PRINTED.values().items()
        if getattr(default, key) != value
    )


KEYS = _printed_keys()
AVOIDERS = (("printed", (_preset("printed"),)), ("robust", (_preset("robust"),)))
"""Both presets of the avoider as settings."""
RANGES = (
    *AVOIDERS,
    ("printed, window of 81 cells", (_preset("printed"), WIDE)),
)
METHODS = (("virtual forces", "avoider.plugin=vff@printed"), ("Improved VFH", _preset("printed")))
"""Methods as printed that section I compares at doors."""
DOORS = (1.2, 1.6, 2.0, 2.4)
"""Widths of the doors, m."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A drive that starts off its heading.

    Attributes:
        off: Heading error at the start, degrees.
        above: `controller.turn_in_place_above_deg`.
        drive: The run.
    """

    off: int
    above: int
    drive: Drive


@dataclass(frozen=True, eq=False)
class Reach:
    """From which distance an avoider acts.

    Attributes:
        name: Name of the reading, for people.
        settings: Differences from the config `paper`.
        distances: (n,) distance of the robot's centre from O, m, falling.
        densities: (n,) density of the sector towards O.
        threshold: Density above which a sector is blocked.
        acts_from: Largest distance, m, from which on the sector towards O is blocked; None: never.
        passes: The experiment with O by this reading.
    """

    name: str
    settings: tuple[str, ...]
    distances: Floats
    densities: Floats
    threshold: float
    acts_from: float | None
    passes: Drive


@dataclass(frozen=True, eq=False)
class Door:
    """A drive through an unmapped door.

    Attributes:
        method: Name of the method, for people.
        width: Width of the door, m.
        drive: The run.
    """

    method: str
    width: float
    drive: Drive

    @property
    def passed(self) -> bool:
        """Whether the robot truly reached the goal behind the door, without contact."""
        summary = self.drive.episode.summary()
        return bool(summary["truly_reached"]) and summary["collisions"] == 0


@dataclass(frozen=True, eq=False)
class DriveReadings:
    """All drives.

    Attributes:
        shapes: The drive without O on the rounded path, and along the planned cells.
        turns: Drives that start off their heading, with and without turns in place.
        avoiders: The experiment with O by the printed avoider and by the robust one.
        tallies: The same with the seeds of `seeds.SEEDS`.
        alone: The robust avoider with one key as printed at a time; name is the setting.
        ranges: From which distance each reading of the avoider acts.
        doors: Forces and Improved VFH as printed, at doors of several widths.
    """

    shapes: tuple[Variant, ...]
    turns: tuple[Turn, ...]
    avoiders: tuple[Variant, ...]
    tallies: tuple[Tally, ...]
    alone: tuple[Variant, ...]
    ranges: tuple[Reach, ...]
    doors: tuple[Door, ...]

    def range_of(self, run: Drive) -> float | None:
        """Distance from which the avoider of a run acts, m; None if it is not among the readings, or never acts."""
        wanted = _avoider_of(run)
        return next((reach.acts_from for reach in self.ranges if _avoider_of(reach.passes) == wanted), None)


def _avoider_of(run: Drive) -> dict[str, object]:
    """Parameters of a run's avoider."""
    system = run.episode.system
    found: dict[str, object] = system.parts[("avoider", system.config.avoider.instance)].params.model_dump()
    return found


def steps_of_readings() -> int:
    """Number of calls of `say` by `readings_of`."""
    return (
        len(SHAPES)
        + len(OFFS) * len(IN_PLACE)
        + 2 * len(AVOIDERS)
        + len(KEYS)
        + len(RANGES)
        + len(METHODS) * len(DOORS)
    )


def readings_of(seed: int | None, say: Callable[[str], None]) -> DriveReadings:
    """Run every drive.

    Args:
        seed: Seed of single drives with noise; None: the config's. Tallies have seeds of their own.
        say: Called with the name of each drive before it starts.
    """

    def run(name: str, *settings: str) -> Variant:
        say(name)
        return Variant(name, settings, drive(*settings, seed=seed))

    def turned(off: int, above: int) -> Turn:
        say(f"start {off}° off the first leg")
        start = f"navigation.start={{x=0,y=0,heading_deg={90 - off}}}"
        return Turn(off, above, drive(*OPEN, start, f"controller.turn_in_place_above_deg={above}"))

    def tally(name: str, settings: tuple[str, ...]) -> Tally:
        say(f"20 seeds, {name}")
        return driven(name, *settings)

    def reach(name: str, settings: tuple[str, ...]) -> Reach:
        say(f"range, {name}")
        return reach_of(name, settings, seed)

    def through(method: str, setting: str, width: float) -> Door:
        say(f"{method} at a door of {width:g} m")
        there = (f"world.ref=door:{width:g}", "navigation.goal={x=0,y=6}")
        return Door(method, width, drive(*there, setting, seed=seed))

    robust = AVOIDERS[1][1]
    return DriveReadings(
        shapes=tuple(run(name, ROOM, setting) for name, setting in SHAPES),
        turns=tuple(turned(off, above) for off in OFFS for above, _ in IN_PLACE),
        avoiders=tuple(run(name, *settings) for name, settings in AVOIDERS),
        tallies=tuple(tally(name, settings) for name, settings in AVOIDERS),
        alone=tuple(run(setting, *robust, setting) for setting in KEYS),
        ranges=tuple(reach(name, settings) for name, settings in RANGES),
        doors=tuple(through(method, setting, width) for method, setting in METHODS for width in DOORS),
    )


def reach_of(name: str, settings: tuple[str, ...], seed: int | None = None) -> Reach:
    """Drive straight at O without avoidance and record the density towards it; then drive the experiment itself."""
    passes = drive(*settings, seed=seed)
    obstacle = box(passes.world, "obstacle O")
    seen = drive(*settings, *FROM_AFAR, seed=seed, towards=obstacle.centre).densities
    distances = away_from(obstacle, seen[:, 1:3])
    blocked = np.flatnonzero(seen[:, 3] > seen[:, 4])
    first = float(distances[blocked[0]]) if len(blocked) else None
    return Reach(name, settings, distances, seen[:, 3], float(seen[-1, 4]), first, passes)
