"""The door: checks of a plugin's answer beyond the message's own checks, with the plugin's line in the error.

A message checks each of its fields when it is built, in the plugin's own line. The doors check what spans several
fields or messages: the type of the answer, stamps that increase, the number of the request, and that a path starts
and ends where it should. Each node has one door. It raises `AnswerError`, which names the verb's file and line, before
any other node receives the answer.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import PurePath
from types import NoneType
from typing import Any, Generic, NoReturn, TypeVar

import numpy as np

from navloom.errors import NavloomError
from navloom.messages import (
    Avoidance,
    Contact,
    Hypotheses,
    MapUpdate,
    Message,
    Odometry,
    Path,
    PlanFailure,
    PoseEstimate,
    RangeScan,
    RecoveryStep,
    Sweep,
    TrackingCommand,
    Truth,
    Twist2D,
)
from navloom.messages.kinds import brief
from navloom.roles import (
    LocalizerInput,
    MapperInput,
    PlannerInput,
    Platform,
    PlatformInput,
    PlatformOutput,
    RobotSpec,
    Role,
    SensorSpec,
    answers_of,
    verb_of,
)

__all__ = ["AnswerError", "LocalizerDoor", "MapperDoor", "PlannerDoor", "PlatformDoor", "TwistDoor", "TypeDoor",
           "notes_of", "verb_place"]  # fmt: skip

STAMP_LEAD_NS = 1_000_000_000
"""Largest lead of a stamp over the run clock, ns: a driver's clock may differ a little."""
MAP_STEP_BACK_NS = 1_000_000_000
"""Largest step back of a map's stamp, ns: a map that was cleared restarts from older data."""
MOST_PLACES = 64
"""Most places in a localizer's hypotheses."""
FAR = 10.0
"""Multiple of a limit beyond which a command is reported: the cause is a wrong unit, not a high gain."""
ACROSS = math.radians(45.0)
"""Largest angle between a segment of a path and the heading of a robot that does not drive sideways, rad."""

A = TypeVar("A", bound=TrackingCommand | Avoidance | RecoveryStep)


class AnswerError(NavloomError, ValueError):
    """A plugin's answer does not fit its input. The text says what it gave, what was expected, and the verb's line."""


def verb_place(plugin: Role) -> str:
    """File and line of the verb of a plugin's class, as `planner.py:31`; empty if it has no Python source."""
    # A decorated verb would otherwise name the line of its decorator's wrapper.
    verb: Any = inspect.unwrap(getattr(type(plugin), verb_of(plugin.role)))
    code = getattr(verb, "__code__", None)
    # Only the file's name: the text is recorded, and a path would differ between machines.
    return f"{PurePath(code.co_filename).name}:{code.co_firstlineno}" if code is not None else ""


class _Door:
    """Base of the doors: knows the verb and its place in the source."""

    def __init__(self, plugin: Role) -> None:
        self.verb, self.place = verb_of(plugin.role), verb_place(plugin)

    def refuse(self, given: str, expected: str) -> NoReturn:
        """Raise AnswerError."""
        raise AnswerError(f"{self.verb}() {given}, expected {expected}{f' ({self.place})' if self.place else ''}")

    def refuse_type(self, answer: object, expected: str) -> NoReturn:
        """Raise AnswerError for an answer of another type."""
        self.refuse(f"returned {brief(answer)}", expected)

    def check_ahead(self, name: str, stamp_ns: int, now_ns: int) -> None:
        """Refuse a stamp that is ahead of the run clock."""
        if stamp_ns > now_ns + STAMP_LEAD_NS:
            self.refuse(
                f"gave {name} stamped {_seconds(stamp_ns, now_ns)}",
                f"run clock in ns, which is at {_seconds(now_ns, stamp_ns)}; wall-clock time does not fit",
            )


class TypeDoor(_Door):
    """Checks that an answer is of a class that the verb declares, for roles without a check of their own."""

    def __init__(self, plugin: Role) -> None:
        super().__init__(plugin)
        self._kinds = answers_of(plugin.role)

    def check(self, answer: object) -> Any:
        """The answer as it is. Raises AnswerError."""
        if not isinstance(answer, self._kinds):
            self.refuse_type(answer, " or ".join("None" if kind is NoneType else kind.__name__ for kind in self._kinds))
        return answer


class PlatformDoor(_Door):
    """Checks the answers of a platform: declared message types, stamps that do not go back, only requested sweeps.

    It is also the one place where a reading of `range_max` or more becomes +inf, no echo: many drivers report the limit
    where nothing is, and each reader would otherwise decide by itself whether that is an obstacle.

    Args:
        plugin: The platform.
        sensors: Those it is to provide.
    """

    def __init__(self, plugin: Platform, sensors: Iterable[SensorSpec]) -> None:
        super().__init__(plugin)
        self._sensors = {spec.name: plugin.sensor_kinds.get(spec.kind, Message) for spec in sensors}
        self._newest = dict.fromkeys(self._sensors, 0)
        self._odometry_ns = self._now_ns = 0
        self._asked = 0

    def check(self, answer: object, given: PlatformInput) -> PlatformOutput:
        """The answer, in which readings of `range_max` or more are +inf. Raises AnswerError."""
        if not isinstance(answer, PlatformOutput):
            self.refuse_type(answer, "PlatformOutput")
        self._check_types(answer)
        # The run clock restarted with another platform: stamps may begin again.
        if given.time_ns < self._now_ns:
            self._newest = dict.fromkeys(self._sensors, 0)
            self._odometry_ns = 0
        self._now_ns = given.time_ns
        if given.sweep_request is not None:
            # Requests are repeated under the same number when an answer is late.
            self._asked = max(self._asked, given.sweep_request.request_id)
        stamp_ns = answer.odometry.stamp_ns
        if not self._odometry_ns <= stamp_ns <= self._now_ns + STAMP_LEAD_NS:
            self._refuse_stamp("odometry", stamp_ns, self._odometry_ns)
        self._odometry_ns = stamp_ns
        limited = {}
        for name, scan in answer.scans.items():
            self._check_scan(name, scan)
            if isinstance(scan, (RangeScan, Sweep)) and _reads_its_limit(scan):
                limited[name] = replace(scan, ranges=np.where(scan.ranges < scan.range_max, scan.ranges, np.inf))
        return replace(answer, scans={**answer.scans, **limited}) if limited else answer

    def _check_types(self, answer: PlatformOutput) -> None:
        if not isinstance(answer.odometry, Odometry):
            self.refuse(f"gave odometry={brief(answer.odometry)}", "Odometry")
        if not isinstance(answer.contact, Contact):
            self.refuse(f"gave contact={brief(answer.contact)}", "Contact: Contact(False) for no contact")
        if answer.truth is not None and not isinstance(answer.truth, Truth):
            self.refuse(f"gave truth={brief(answer.truth)}", "Truth or None")
        # The cheap test first: it is made for every platform in every tick.
        if answer.scans.__class__ is not dict and not isinstance(answer.scans, Mapping):
            self.refuse(f"gave scans={brief(answer.scans)}", "messages by sensor name, as {'laser': scan}")

    def _refuse_stamp(self, name: str, stamp_ns: int, before_ns: int) -> NoReturn:
        self.check_ahead(name, stamp_ns, self._now_ns)
        self.refuse(
            f"gave {name} stamped {_seconds(stamp_ns, before_ns)}",
            f"{_seconds(before_ns, stamp_ns)} or later, as the one before",
        )

    def _check_scan(self, name: str, scan: Message) -> None:
        if name not in self._sensors:
            self.refuse(f"gave a scan of {name!r}", f"one of {', '.join(self._sensors) or 'no sensors'}")
        wanted = self._sensors[name]
        if not isinstance(scan, wanted):
            given = type(scan).__name__ if isinstance(scan, Message) else brief(scan)
            self.refuse(f"gave {given} for the sensor {name!r}", wanted.__name__)
        # Only messages of the framework have fields that can be checked here.
        if not isinstance(scan, (RangeScan, Sweep)):
            return
        stamp_ns, before_ns = scan.stamp_ns, self._newest[name]
        if not before_ns <= stamp_ns <= self._now_ns + STAMP_LEAD_NS:
            self._refuse_stamp(f"a scan of {name!r}", stamp_ns, before_ns)
        self._newest[name] = stamp_ns
        if not scan.range_min < scan.range_max:
            self.refuse(
                f"gave a scan of {name!r} with range_min {scan.range_min:g} and range_max {scan.range_max:g}",
                "range_max above range_min: a reading of range_max or more is no echo",
            )
        if isinstance(scan, Sweep) and not 0 <= scan.request_id <= self._asked:
            asked = f"{self._asked}, the newest request, or " if self._asked else ""
            self.refuse(f"gave a sweep for request {scan.request_id}", f"{asked}0 for a continuous sweep")


def _reads_its_limit(scan: RangeScan | Sweep) -> bool:
    """Whether a reading is finite and at least `range_max`."""
    return int(np.count_nonzero(scan.ranges >= scan.range_max)) != int(np.count_nonzero(scan.ranges == np.inf))


class LocalizerDoor(_Door):
    """Checks the answers of a localizer: a pose with the stamp of the odometry that it received."""

    def check(self, answer: object, given: LocalizerInput) -> PoseEstimate:
        """The answer as it is. Raises AnswerError."""
        if not isinstance(answer, PoseEstimate):
            self.refuse_type(answer, "PoseEstimate")
        stamp_ns = given.odometry.stamp_ns
        # Poses are matched with scans by their stamps: a pose of another time would place them wrong without a sign.
        if answer.stamp_ns != stamp_ns:
            self.refuse(
                f"gave a pose stamped {_seconds(answer.stamp_ns, stamp_ns)}",
                f"the odometry's stamp, {_seconds(stamp_ns, answer.stamp_ns)}",
            )
        variances = answer.covariance.diagonal().tolist()
        # Not the whole matrix: its eigenvalues would cost more than the step of a simple localizer.
        if min(variances) < 0.0:
            self.refuse(f"gave variances {variances}", "values of at least 0 on the diagonal of the covariance")
        return answer

    def check_places(self, places: object) -> Hypotheses:
        """The places where the robot may be, as they are. Raises AnswerError."""
        if not isinstance(places, Hypotheses):
            self.refuse_type(places, "Hypotheses or None")
        if len(places.poses) > MOST_PLACES:
            self.refuse(f"gave {len(places.poses)} hypotheses", f"at most {MOST_PLACES}")
        return places


class MapperDoor(_Door):
    """Checks the answers of a mapper: a map that is not ahead of the run clock and not older than the previous map."""

    def __init__(self, plugin: Role) -> None:
        super().__init__(plugin)
        self._newest = self._now_ns = 0

    def check(self, answer: object, given: MapperInput) -> MapUpdate | None:
        """The answer as it is. Raises AnswerError."""
        if given.stamp_ns < self._now_ns:  # the run clock restarted
            self._newest = 0
        self._now_ns = given.stamp_ns
        if answer is None:
            return None
        if not isinstance(answer, MapUpdate):
            self.refuse_type(answer, "MapUpdate or None")
        self.check_ahead("a map", answer.stamp_ns, given.stamp_ns)
        # A mapper that was cleared restarts from older data.
        if answer.stamp_ns < self._newest - MAP_STEP_BACK_NS:
            self.refuse(
                f"gave a map stamped {_seconds(answer.stamp_ns, self._newest)}",
                f"the stamp of its newest data, which was {_seconds(self._newest, answer.stamp_ns)} in the map before",
            )
        self._newest = answer.stamp_ns
        if not answer.grid.cells.size:
            self.refuse(f"gave a grid of shape {answer.grid.cells.shape}", "at least one cell, or None for no map")
        return answer


class PlannerDoor(_Door):
    """Checks the answers of a planner: to the current request, with a path from its start to its goal.

    Args:
        plugin: The planner.
        tolerance: How near to its goal a robot must come, m. A path's ends may be off by this or by the diagonal of a
            cell, whichever is larger.
        robot: Only a holonomic one drives across its heading.
    """

    def __init__(self, plugin: Role, tolerance: float, robot: RobotSpec | None = None) -> None:
        super().__init__(plugin)
        self.tolerance = tolerance
        self._is_holonomic = robot is not None and robot.drive == "holonomic"

    def check(self, answer: object, given: PlannerInput) -> Path | PlanFailure:
        """The answer as it is. Raises AnswerError."""
        if not isinstance(answer, (Path, PlanFailure)):
            self.refuse_type(answer, "Path or PlanFailure")
        request = given.request
        if answer.request_id != request.request_id:
            self.refuse(f"answered request {answer.request_id}", f"request {request.request_id}, which was asked")
        if isinstance(answer, Path):
            # A planner may plan on a coarser grid than the map's.
            grid = given.map.grid if answer.traversable is None else answer.traversable
            # A path on cell centres may begin and end up to half a diagonal away from the places asked for.
            slack = max(self.tolerance, math.sqrt(2.0) * grid.resolution)
            points = answer.points
            for name, (x, y), asked in (("starts", points[0], request.start), ("ends", points[-1], request.goal)):
                if math.hypot(x - asked.x, y - asked.y) > slack:
                    self.refuse(
                        f"gave a path that {name} at ({x:.2f}, {y:.2f})",
                        f"({asked.x:.2f}, {asked.y:.2f}), as asked, within {slack:.2f} m",
                    )
            self._check_headings(answer)
        return answer

    def _check_headings(self, path: Path) -> None:
        """Refuse a segment across the heading, along which only a holonomic robot can drive."""
        if path.headings is None or self._is_holonomic:
            return
        legs, turns = np.diff(path.points, axis=0), np.remainder(np.diff(path.headings) + math.pi, math.tau) - math.pi
        off = np.arctan2(legs[:, 1], legs[:, 0]) - (path.headings[:-1] + 0.5 * turns)
        off = np.abs(np.remainder(off + math.pi, math.tau) - math.pi)
        across = (np.minimum(off, math.pi - off) > ACROSS) & (legs != 0.0).any(axis=1)
        if across.any():
            k = int(across.argmax())
            self.refuse(
                f"gave a path with headings whose segment {k} lies {math.degrees(off[k]):.0f}° off its heading",
                f"at most {math.degrees(ACROSS):.0f}°, forwards or backwards: this robot does not drive sideways",
            )


class TwistDoor(_Door, Generic[A]):
    """Checks the answers of a role that commands a velocity.

    A command beyond the robot's limits passes, since the gate limits it. The first one far beyond them is noted.

    Args:
        plugin: The controller, avoider or recovery.
        kind: Type of its answers.

    Attributes:
        notes: Notes for the operator, worded to follow the plugin's name.
    """

    def __init__(self, plugin: Role, kind: type[A]) -> None:
        super().__init__(plugin)
        self.notes: list[str] = []
        self._kind: type[A] = kind
        # Infinite limits are never exceeded, so that a plugin without a context passes.
        self._speed = self._turn = math.inf
        context = getattr(plugin, "context", None)  # a plugin's own __init__ may not store it
        if context is not None:
            self._speed, self._turn = context.robot.max_linear, context.robot.max_angular
        self._far_speed, self._far_turn = FAR * self._speed, FAR * self._turn

    def check(self, answer: object) -> A:
        """The answer as it is. Raises AnswerError."""
        if not isinstance(answer, self._kind):
            self.refuse_type(answer, self._kind.__name__)
        twist, turn, speed = answer.twist, self._far_turn, self._far_speed
        # The first one says it all: a wrong unit repeats in every tick.
        if not (-turn < twist.wz < turn and -speed < twist.vx < speed) and not self.notes:
            self._note(twist)
        return answer

    def _note(self, twist: Twist2D) -> None:
        turns, speeds = abs(twist.wz) / self._turn, abs(twist.vx) / self._speed
        if turns >= speeds:
            said = f"{turns:.0f} times the turn limit: degrees? It gave {twist.wz:.3g} rad/s of {self._turn:.3g}"
        else:
            said = f"{speeds:.0f} times the speed limit. It gave {twist.vx:.3g} m/s of {self._speed:.3g}"
        self.notes.append(f"asked for {said} ({self.place}); the gate limits it")


def notes_of(node: object) -> list[str]:
    """Notes for the operator from the door of a node."""
    found: list[str] = getattr(getattr(node, "door", None), "notes", [])
    return found


def _seconds(stamp_ns: int, other_ns: int) -> str:
    """A stamp as text, with as many digits as tell it from another one."""
    text, other = (f"{ns / 1e9:.3f} s" for ns in (stamp_ns, other_ns))
    if text != other or stamp_ns == other_ns:
        return text
    # In whole numbers: a float has too few digits for the nanoseconds of a wall clock.
    sign = "-" if stamp_ns < 0 else ""
    return f"{sign}{abs(stamp_ns) // 10**9}.{abs(stamp_ns) % 10**9:09} s"
