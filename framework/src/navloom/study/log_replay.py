"""Mappers and avoiders on an imported log: what they would have made of what another robot saw."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.config import ConfigError, Loaded
from navloom.dataflow.differences import differences
from navloom.dataflow.nodes import Node, Tick, fault_text
from navloom.dataflow.reference import ReferenceNode
from navloom.messages import Command, MapUpdate, Message, Odometry, Point2D, PoseEstimate, RangeScan, Reference, Sweep
from navloom.recording.reader import Recorded, Recording
from navloom.recording.recorded_platform import discovery
from navloom.runtime.build import assemble, make_plugins, role_nodes
from navloom.study.shadows import Disagreement
from navloom.study.substitutes import Substitute

__all__ = ["DRIVER", "LogReplay", "replay_log"]

Floats = NDArray[np.float64]
DRIVER = "the driver"
"""Whom an avoider's answers are compared with: the velocity that was driven."""
WAY_STEP = 0.2
"""m between points of the way ahead."""
ENDED = 0.1
"""m left of the driven way from which there is nothing to compare."""
TRACK = 4096


@dataclass(eq=False)
class LogReplay:
    """What came of a log.

    Attributes:
        seconds: Length of the log, s.
        ticks: Stepped.
        map: The last map; None without a mapper or where it made none.
        maps: How many it made.
        way: (n, 2) where the robot was, m, map frame.
        avoider: Compared with the driver; None without an avoider.
        faults: What a plugin raised, by tick.
    """

    seconds: float = 0.0
    ticks: int = 0
    map: MapUpdate | None = None
    maps: int = 0
    way: Floats = field(default_factory=lambda: np.empty((0, 2)))
    avoider: Substitute | None = None
    faults: list[str] = field(default_factory=list)

    def summary(self) -> dict[str, Any]:
        """For `replay --json`."""
        steps = np.diff(self.way, axis=0)
        found: dict[str, Any] = {
            "seconds": self.seconds,
            "ticks": self.ticks,
            "driven_m": float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
            "faults": len(self.faults),
            "first_fault": self.faults[0] if self.faults else None,
        }
        if self.map is not None:
            cells = self.map.grid.cells
            found["map"] = {
                "updates": self.maps,
                "resolution_m": self.map.grid.resolution,
                "cells": int(cells.size),
                "free": int((cells == 0).sum()),
                "occupied": int((cells >= 50).sum()),
                "unknown": int((cells < 0).sum()),
                "segments": len(self.map.segments),
            }
        if self.avoider is not None:
            found["avoider"] = self.avoider.summary()
        return found


def replay_log(
    recording: Recording, loaded: Loaded, roles: Sequence[str], say: Callable[[str], None] = lambda text: None
) -> LogReplay:
    """Step localizer and mapper, or localizer and avoider, or all of them, on what an imported log holds.

    The avoider is given the way that was driven as its trajectory, and the velocity that was driven as the one wanted.

    Args:
        recording: An imported one.
        loaded: Its config with the plugins to try.
        roles: Of "mapper" and "avoider", which to step.
        say: Told what is being prepared.

    Raises:
        ConfigError: A role that a log cannot feed.
    """
    wrong = [role for role in roles if role not in ("mapper", "avoider", "localizer")]
    if wrong:
        raise ConfigError(f"--{wrong[0]}: an imported log feeds mappers, avoiders and localizers: it holds no plans")
    runner = _Runner(recording, loaded, roles, say)
    return runner.run()


class _Runner:
    """Steps the nodes, tick by tick of the log."""

    def __init__(self, recording: Recording, loaded: Loaded, roles: Sequence[str], say: Callable[[str], None]) -> None:
        self.recording, self.config = recording, loaded.config
        self.system = assemble(loaded, discovery())
        used = {"localizer", *roles}
        wanted = {(role, self.config.role_table(role).instance) for role in used}
        make_plugins(self.system, say, wanted)
        nodes = role_nodes(self.system, wanted)
        self.nodes: dict[str, Node] = {role: nodes[role, self.config.role_table(role).instance] for role in used}
        self.sensors = {
            spec.role: [one.name for one in spec.inputs if one.name.startswith("scan.")] for spec in self.system.specs
        }
        self.reference = ReferenceNode.of(self.config, self.system.robot)
        self.result = LogReplay()
        if "avoider" in roles:
            name = self.config.avoider.instance
            self.result.avoider = Substitute(Disagreement("avoider", name))
        self.track: list[PoseEstimate] = []
        self.waiting: list[tuple[str, RangeScan | Sweep]] = []

    def run(self) -> LogReplay:
        """Through the whole log."""
        way = self._driven()
        period_ns = round(self.config.run.period * 1e9)
        first_ns = last_ns = 0
        for number, messages in self._ticks(period_ns):
            stamps = [one.envelope.stamp_ns for one in messages]
            first_ns = first_ns or min(stamps)
            last_ns = max(last_ns, *stamps)
            tick = Tick(number, last_ns * 1e-9, last_ns, 0)
            self._take(tick, messages)
            ready = self._covered()
            self._map(tick, ready)
            self._avoid(tick, messages, way)
            self.result.ticks += 1
        self.result.seconds = (last_ns - first_ns) * 1e-9
        self.result.way = np.array([(pose.x, pose.y) for pose in way[1]]).reshape(-1, 2)
        if self.result.avoider is not None:
            self.result.avoider.recorded_map = self.result.map
            self.result.avoider.way = self._at
        return self.result

    def _ticks(self, period_ns: int) -> Iterator[tuple[int, list[Recorded]]]:
        """Messages by tick, in the order they were received."""
        held: list[Recorded] = []
        number = -1
        for one in self.recording.messages(["platform/*/*"]):
            tick = max(number, one.envelope.tick)
            if tick != number and held:
                yield number, held
                held = []
            number = tick
            held.append(one)
        if held:
            yield number, held

    def _driven(self) -> tuple[Floats, list[Any]]:
        """Run times, ns, and poses of the whole log by odometry: the way an avoider is given as its trajectory."""
        nodes = role_nodes(self.system, {("localizer", self.config.localizer.instance)})
        localizer = next(iter(nodes.values()))
        stamps, poses = [], []
        for one in self.recording.messages(["platform/*/odometry"]):
            estimate = self._localized(localizer, one)
            if estimate is not None:
                stamps.append(one.envelope.stamp_ns)
                poses.append(estimate.pose)
        make_plugins(self.system, only={("localizer", self.config.localizer.instance)})
        self.nodes["localizer"] = next(
            iter(role_nodes(self.system, {("localizer", self.config.localizer.instance)}).values())
        )
        points = np.array([(pose.x, pose.y) for pose in poses]).reshape(-1, 2)
        steps = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.empty(0)
        self.along = np.concatenate([[0.0], np.cumsum(steps)])
        self.points = points
        self._at: list[tuple[int, float, float]] = []
        return np.array(stamps, dtype=np.int64), poses

    def _localized(self, node: Node, one: Recorded) -> PoseEstimate | None:
        given = dict.fromkeys(self.sensors["localizer"], ()) | {"odometry": one.message, "map": None}
        tick = Tick(one.envelope.tick, one.envelope.stamp_ns * 1e-9, one.envelope.stamp_ns, 0)
        pose = dict(node.step(tick, given)).get("pose")
        return pose if isinstance(pose, PoseEstimate) else None

    def _take(self, tick: Tick, messages: Sequence[Recorded]) -> None:
        """Localize with every odometry, and put the scans in wait for poses that cover them."""
        for one in messages:
            port = one.key.rsplit("/", 1)[1]
            if isinstance(one.message, Odometry):
                pose = self._localized(self.nodes["localizer"], one)
                if pose is not None and (not self.track or pose.stamp_ns > self.track[-1].stamp_ns):
                    self.track.append(pose)
            elif isinstance(one.message, (RangeScan, Sweep)):
                self.waiting.append((f"scan.{port}", one.message))
        del self.track[:-TRACK]

    def _covered(self) -> dict[str, list[Message]]:
        """Scans that the track covers by now, by input; those from before its beginning never will be."""
        ready: dict[str, list[Message]] = {}
        left = []
        for name, scan in self.waiting:
            if not self.track or _end_ns(scan) > self.track[-1].stamp_ns:
                left.append((name, scan))
            elif scan.stamp_ns >= self.track[0].stamp_ns:
                ready.setdefault(name, []).append(scan)
        self.waiting = left
        return ready

    def _map(self, tick: Tick, ready: dict[str, list[Message]]) -> None:
        node = self.nodes.get("mapper")
        if node is None or not any(name in ready for name in self.sensors["mapper"]):
            return
        given: dict[str, Any] = {name: tuple(ready.get(name, ())) for name in self.sensors["mapper"]}
        for _, message in self._step(node, tick, given | {"track": list(self.track), "clear": ()}):
            if isinstance(message, MapUpdate):
                self.result.map, self.result.maps = message, self.result.maps + 1

    def _avoid(self, tick: Tick, messages: Sequence[Recorded], way: tuple[Floats, list[Any]]) -> None:
        node, result = self.nodes.get("avoider"), self.result.avoider
        if node is None or result is None or not self.track:
            return
        driven = next((one.message for one in reversed(messages) if isinstance(one.message, Odometry)), None)
        if driven is None:
            return
        pose = self.track[-1]
        reference = self._reference(pose, driven, int(np.searchsorted(way[0], pose.stamp_ns)))
        if reference is None:
            return
        scans: dict[str, list[Message]] = {name: [] for name in self.sensors["avoider"]}
        for one in messages:
            name = f"scan.{one.key.rsplit('/', 1)[1]}"
            if name in scans:
                scans[name].append(one.message)
        wanted = Command(driven.twist)
        given: dict[str, Any] = {"desired": wanted, **{name: tuple(found) for name, found in scans.items()}}
        outputs = dict(self._step(node, tick, given | {"pose": pose, "reference": reference}))
        result.steps += 1
        self._at.append((tick.number, pose.pose.x, pose.pose.y))
        if "command" in outputs:
            result.last = outputs["command"]
            found = differences("avoider", wanted, outputs["command"])
            result.found.add(tick.number, tick.time, DRIVER, found)

    def _reference(self, pose: PoseEstimate, driven: Odometry, place: int) -> Reference | None:
        """The way that was driven from here on, as the reference node would say it."""
        place = min(place, len(self.along) - 1)
        progress = float(self.along[place])
        left = float(self.along[-1]) - progress
        if left < ENDED:
            return None
        reach = min(self.reference.look_ahead, left)
        arcs = progress + np.append(np.arange(0.0, reach, WAY_STEP), reach)
        way = np.column_stack([np.interp(arcs, self.along, self.points[:, axis]) for axis in (0, 1)])
        target = Point2D(float(way[-1, 0]), float(way[-1, 1]))
        twist = driven.twist
        return Reference(
            1, progress, left, pose.pose, twist.vx, twist.wz, 0.0, target, way, self.reference.corridor, None
        )

    def _step(self, node: Node, tick: Tick, given: dict[str, Any]) -> Any:
        try:
            return node.step(tick, given)
        except (Exception, SystemExit) as error:
            self.result.faults.append(f"tick {tick.number}: {fault_text(error, node)}")
            return []


def _end_ns(scan: RangeScan | Sweep) -> int:
    """When the last of a scan was measured, ns."""
    offsets = scan.frame_times if isinstance(scan, Sweep) else scan.time_offsets
    return scan.stamp_ns + (round(float(offsets.max()) * 1e9) if offsets.size else 0)
