"""What tests of the viewer share: facts of a small robot, a sink that keeps messages, and a reader of .rrd files."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from navloom.geometry.footprints import rectangle
from navloom.geometry.world import Box, World
from navloom.messages import Message, Pose2D, PoseEstimate, Twist2D
from navloom_viewer.drawing import Shown
from navloom_viewer.picture_setup import Facts, Variant


def variant(name: str = "r1", shadows: tuple[tuple[str, str], ...] = ()) -> Variant:
    """A square robot of 0.8 m with a goal 4 m ahead."""
    charge = {"avoider": "main_avoider", "platform": "sim"}
    return Variant(name, rectangle(0.8, 0.8), 1.2, Pose2D(0.0, 0.0, 0.0), (4.0, 0.0), 0.2, charge, charge, shadows)


def facts_for(*names: str, shadows: tuple[tuple[str, str], ...] = ()) -> Facts:
    """Robots in a room with one wall, a girder above, and a box that appears after the sweep."""
    world = World(
        "room",
        (
            Box("wall", (5.0, 5.2), (-3.0, 3.0)),
            Box("girder", (2.0, 2.2), (-3.0, 3.0), (1.5, 1.7)),
            Box("surprise", (1.8, 2.2), (-0.2, 0.2), (0.0, 0.5), appears_after_sweep=True),
        ),
        bounds=(-3.0, -3.0, 6.0, 3.0),
    )
    return Facts("test", tuple(variant(name, shadows) for name in names or ("r1",)), world)


def shown(
    message: Message, role: str = "platform", port: str = "x", *, tick: int = 0, instance: str = "main",
    active: bool = True, name: str = "r1",
) -> Shown:  # fmt: skip
    """A message as an executor delivers it, at 20 Hz."""
    return Shown(name, role, instance, active, port, message, tick, tick * 50_000_000)


def pose_at(x: float, y: float, heading: float = 0.0, tick: int = 0, name: str = "r1") -> Shown:
    """A localizer's estimate."""
    estimate = PoseEstimate(tick * 50_000_000, Pose2D(x, y, heading), Twist2D(0.3, 0.0, 0.1), np.zeros((3, 3)))
    return shown(estimate, "localizer", "pose", tick=tick, name=name)


@dataclass
class Memory:
    """A sink that keeps what it gets: (path, archetypes, tick, stamp), and numbers by path."""

    logged: list[tuple[str, tuple[Any, ...], int | None, int]] = field(default_factory=list)
    numbers: dict[str, list[tuple[int, float]]] = field(default_factory=dict)
    layouts: int = 0
    closed: bool = False

    def layout(self, blueprint: Any) -> None:
        """Count it."""
        self.layouts += 1

    def log(self, path: str, archetypes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
        """Keep it."""
        self.logged.append((path, tuple(archetypes), tick, stamp_ns))

    def series(self, path: str, ticks: Any, stamps_ns: Any, values: Any) -> None:
        """Keep them."""
        self.numbers.setdefault(path, []).extend(zip(ticks.tolist(), values.tolist(), strict=True))

    def close(self) -> None:
        """Do nothing."""
        self.closed = True

    def at(self, path: str) -> list[Any]:
        """First archetype of each log at a path, in order of time."""
        return [shapes[0] for where, shapes, tick, _ in self.logged if where == path and tick is not None]

    def frame_of(self, path: str) -> str:
        """Frame of an entity."""
        frames = [s for where, shapes, tick, _ in self.logged if where == path and tick is None for s in shapes]
        found = [s for s in frames if type(s).__name__ == "CoordinateFrame"]
        return str(component(found[-1], "frame")[0])


def component(archetype: Any, name: str) -> list[Any]:
    """Values of one component of an archetype."""
    for batch in archetype.as_component_batches():
        if batch.component_descriptor().component.split(":")[-1] == name:
            return list(batch.as_arrow_array().to_pylist())
    return []


def rows_of(path: Path) -> Counter[str]:
    """Rows by entity in an .rrd file, as the viewer's own program reads it; without its layout."""
    binary = Path(str(import_module("rerun_cli").__file__)).parent / "rerun"
    done = subprocess.run([binary, "rrd", "print", path], capture_output=True, text=True, check=True)
    found: Counter[str] = Counter()
    for line in done.stdout.splitlines():
        if (match := re.search(r"with (\d+) rows .*?(/\S+)", line)) and "SeriesLines:" not in line:
            found[match[2]] += int(match[1])
    return found
