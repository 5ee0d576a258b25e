"""Plugins for tests: a simulated robot that records each motor command, and plugins that fail on demand.

A file in the folder that NAVLOOM_FAULTS names makes them fail: `touch INSTANCE.WAY`, with one of the ways of `fail`.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import multiprocessing
import os
import re
import resource
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from motor_record import ADVANCE, DRIVE, RECORD, START, Line
from navloom import (
    Avoidance,
    AvoiderInput,
    ControllerInput,
    MapperInput,
    MapUpdate,
    PlanFailure,
    PlannerInput,
    PlatformInput,
    PlatformOutput,
    Registry,
    TrackingCommand,
    Twist2D,
    hookimpl,
)
from navloom import Path as Way
from navloom_astar.adapter import AStar
from navloom_improved_vfh.adapter import ImprovedVfh
from navloom_known_map.adapter import KnownMap
from navloom_lyapunov_tracker.adapter import LyapunovTracker
from navloom_sensors_sim.adapter import SensorsSim

__all__ = ["FOLDER", "install"]

FOLDER = "NAVLOOM_FAULTS"
"""Environment variable: folder of the files that make a plugin fail."""
MODULE = Path(__file__).stem


class LoggedSim(SensorsSim):
    """The simulated robot; appends each motor command to the file that NAVLOOM_MOTOR_RECORD names."""

    name = "logged_sim"

    def reset(self) -> None:
        """Back to the start of the run."""
        super().reset()
        self._file = os.open(os.environ[RECORD], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        self._write(START, Twist2D(0.0, 0.0, 0.0))

    def drive(self, command: Twist2D, time_ns: int) -> None:
        """Record a command, and pass it to the wheels."""
        self._write(DRIVE, command)
        super().drive(command, time_ns)

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Advance, and record the true state."""
        output = super().advance(given)
        truth = output.truth
        assert truth is not None
        place = (truth.pose.x, truth.pose.y, truth.twist.vx, truth.twist.wz, truth.clearance)
        self._write(ADVANCE, given.command, truth.touching, *place)
        return output

    def _write(self, kind: int, twist: Twist2D, touching: bool = False, *truth: float) -> None:
        values = truth or (math.nan,) * 5
        os.write(
            self._file, Line(kind, touching, os.getpid(), time.monotonic_ns(), twist.vx, twist.wz, *values).bytes()
        )


def fork(*, has_session: bool = False, is_stray: bool = False) -> None:
    """Fork a child that sleeps or, if stray, continues here."""
    if os.fork() == 0:
        if has_session:
            os.setsid()
        if not is_stray:
            time.sleep(3600)
            os._exit(0)


def flood() -> None:
    """Print 100 MB twice, and a last line."""
    for _ in range(2):
        print("x" * 10**8, flush=True)
    print("the last word", flush=True)


KEPT: list[Any] = []
"""Objects that must live as long as this process."""
DONE: set[str] = set()
"""Files that this process has already obeyed once."""
ONCE: dict[str, Callable[[], Any]] = {
    "fork": fork,
    "daemon": lambda: fork(has_session=True),
    "stray": lambda: fork(is_stray=True),
    "pool": lambda: KEPT.append(multiprocessing.get_context("fork").Pool(2)),
    "flood": flood,
}
WAYS = ("hang", "spin", "seize", "hold", *ONCE, "raise", "nan", "smuggle", "eat", "open")
"""Ways to fail, see `fail`."""


def nan_twist() -> Twist2D:
    """A NaN twist made past the checks of the constructor."""
    twist = Twist2D(0.0, 0.0, 0.0)
    Twist2D.__dict__["vx"].__set__(twist, math.nan)
    return twist


def fail(instance: str) -> str:
    """Fail as a file orders.

    Ways: `hang` sleeps for ever; `spin` computes for ever; `seize` computes for ever in one call of C code that holds
    the GIL; `hold` sleeps for ever in such a call; `raise` raises; `nan` makes a command of NaN; `smuggle` returns one
    made past the checks; `eat` allocates memory without end; `open` takes every descriptor that its process may have,
    until its file is gone. Once each: `fork` forks a child that sleeps, `daemon` one in its own session, `stray` one
    that continues as if it were the node; `pool` starts a pool of two processes; `flood` prints 100 MB twice.

    Returns:
        "smuggle", or an empty text.
    """
    folder = os.environ[FOLDER]
    for way in WAYS:
        entry = f"{instance}.{way}"
        if not os.path.exists(os.path.join(folder, entry)):  # unlike `listdir`, it needs no descriptor
            continue
        if way == "hang":
            threading.Event().wait()
        elif way == "spin":
            while True:
                pass
        elif way == "seize":
            re.match(r"(a+)+$", "a" * 64 + "b")
        elif way == "hold":
            ctypes.PyDLL(None).sleep(3600)
        elif way in ONCE and entry not in DONE:
            DONE.add(entry)
            ONCE[way]()
        elif way == "raise":
            raise RuntimeError("told to fail")
        elif way == "nan":
            Twist2D(math.nan, 0.0, 0.0)
        elif way == "smuggle":
            return way
        elif way == "eat":
            while True:
                HOARD.append(b"x" * 2**25)
        elif way == "open":
            take_descriptors()
            return ""
    if HOARD:
        HOARD.clear()
        limit = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
    return ""


HOARD: list[Any] = []
"""Memory or descriptors that a plugin keeps from others."""
FEW_FILES = 8
"""Descriptors that a process may still open, so few that they are used up at once."""


def take_descriptors() -> None:
    """Open files until the limit of descriptors is reached."""
    if not HOARD:
        used = len(os.listdir("/proc/self/fd"))
        resource.setrlimit(resource.RLIMIT_NOFILE, (used + FEW_FILES, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    with contextlib.suppress(OSError):
        while True:
            HOARD.append(open(os.devnull))  # noqa: SIM115


class FaultyTracker(LyapunovTracker):
    """The tracker, with failures on demand."""

    name = "faulty_tracker"

    def control(self, given: ControllerInput) -> TrackingCommand:
        """Velocity for this tick."""
        way, answer = fail(self.context.instance), super().control(given)
        if way:
            TrackingCommand.__dict__["twist"].__set__(answer, nan_twist())
        return answer


class FaultyVfh(ImprovedVfh):
    """The avoider, with failures on demand."""

    name = "faulty_vfh"

    def avoid(self, given: AvoiderInput) -> Avoidance:
        """Velocity for this tick."""
        way, answer = fail(self.context.instance), super().avoid(given)
        if way:
            Avoidance.__dict__["twist"].__set__(answer, nan_twist())
        return answer


class FaultyAStar(AStar):
    """The planner, with failures on demand."""

    name = "faulty_astar"

    def plan(self, given: PlannerInput) -> Way | PlanFailure:
        """A path."""
        fail(self.context.instance)
        return super().plan(given)


class FaultyMap(KnownMap):
    """The mapper, with failures on demand."""

    name = "faulty_map"

    def update(self, given: MapperInput) -> MapUpdate | None:
        fail(self.context.instance)
        return super().update(given)


PARTS: tuple[Any, ...] = (LoggedSim, FaultyTracker, FaultyVfh, FaultyAStar, FaultyMap)


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add all of them; each has an entry point to this module."""
    for part in PARTS:
        registry.add(part)


def install(folder: Path) -> str:
    """Make these plugins appear installed to processes whose PYTHONPATH begins with the returned text.

    Args:
        folder: Folder of their metadata; it must not exist.
    """
    about = folder / f"{MODULE}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {MODULE}\nVersion: 1.0\n", "utf-8")
    entries = [f"{part.role}.{part.name} = {MODULE}" for part in PARTS]
    (about / "entry_points.txt").write_text("\n".join(["[navloom]", *entries, ""]), "utf-8")
    return os.pathsep.join((str(folder), str(Path(__file__).parent)))
