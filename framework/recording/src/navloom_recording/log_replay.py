"""Runs localizers, mappers and avoiders on an imported log, to see what they make of another robot's sensor data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from navloom.config import ConfigError, Loaded
from navloom.engine.build import assemble
from navloom.engine.differences import differences
from navloom.engine.nodes.node_base import Tick
from navloom.engine.nodes.reference_node import ReferenceNode
from navloom.engine.open_loop_node import FedNode
from navloom.engine.plugin_factory import make_plugins, role_nodes
from navloom.geometry.frames import compose
from navloom.geometry.polylines import Polyline
from navloom.messages import (
    Command,
    MapUpdate,
    Message,
    OccupancyGrid,
    Odometry,
    Point2D,
    PoseEstimate,
    RangeScan,
    Reference,
    Sweep,
)
from navloom.runs.shadow_comparison import Disagreement
from numpy.typing import NDArray

from navloom_recording.imported_log import discovery, placed_in_map
from navloom_recording.localizer_track import LocalizerTrack
from navloom_recording.reader import Recorded, Recording
from navloom_recording.substitutes import Substitute

__all__ = ["DRIVER", "LogReplay", "place_in_map", "replay_log"]

Floats = NDArray[np.float64]
DRIVER = "the driver"
"""Name of the reference that an avoider is compared with: the velocity that was driven."""
WAY_STEP = 0.2
"""Spacing of the points of the track ahead, m."""
ENDED = 0.1
"""Remaining length of the driven track below which nothing is compared, m."""
TRACK = 4096


@dataclass(eq=False)
class LogReplay:
    """Result of plugins on a log.

    Attributes:
        seconds: Length of the log, s.
        ticks: Number of ticks stepped.
        map: The last map; None without a mapper or if it made none.
        maps: Number of maps made.
        way: (n, 2) driven track, m, map frame.
        avoider: Comparison with the driver; None without an avoider.
        has_mapper: Whether a mapper was stepped.
        localizer: Name of the requested localizer; empty for none.
        poses: The localizer's poses beside the recorded odometry; None if no localizer was requested.
        known: Map that the localizer was given; None for none.
        faults: Exceptions of plugins, with their ticks.
    """

    seconds: float = 0.0
    ticks: int = 0
    map: MapUpdate | None = None
    maps: int = 0
    way: Floats = field(default_factory=lambda: np.empty((0, 2)))
    avoider: Substitute | None = None
    has_mapper: bool = False
    localizer: str = ""
    poses: LocalizerTrack | None = None
    known: OccupancyGrid | None = None
    faults: list[str] = field(default_factory=list)

    def summary(self) -> dict[str, Any]:
        """The result as `replay --json` prints it."""
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
        if self.poses is not None:
            found["localizer"] = {"instance": self.localizer, **self.poses.summary()}
        if self.avoider is not None:
            found["avoider"] = self.avoider.summary()
        return found


def place_in_map(
    recording: Recording, loaded: Loaded, map_ref: str | None, start: tuple[float, float, float] | None
) -> Loaded:
    """An imported log's config with a map and the pose of the odometry frame in it.

    Args:
        recording: The log.
        loaded: Its config.
        map_ref: A world's reference, or the .yaml of a map_server; None for no map.
        start: x, y, m, heading, rad, of the robot in the map when the log begins; None if the odometry frame is the
            map frame.

    Raises:
        ConfigError: The map cannot be read.
    """
    first = next(message.message for message in recording.messages(["platform/*/odometry"]))
    assert isinstance(first, Odometry)
    if map_ref is not None:  # a path given now is relative to the current folder, not to that of the import
        loaded = replace(loaded, base=Path.cwd())
    return placed_in_map(loaded, map_ref, start, first.pose)


def replay_log(
    recording: Recording, loaded: Loaded, roles: Sequence[str], say: Callable[[str], None] = lambda text: None
) -> LogReplay:
    """Step the localizer, and a mapper or an avoider or both, on the messages of an imported log.

    The avoider receives the driven track as its trajectory and the driven velocity as the desired one.

    Args:
        recording: An imported recording.
        loaded: Its config with the plugins to try.
        roles: Those of "mapper", "avoider" and "localizer" to try.
        say: Receives progress of the preparation.

    Raises:
        ConfigError: A log cannot feed the role, or a plugin needs a map and there is none.
    """
    wrong = [role for role in roles if role not in ("mapper", "avoider", "localizer")]
    if wrong:
        raise ConfigError(f"--{wrong[0]}: an imported log feeds mappers, avoiders and localizers: it holds no plans")
    if loaded.config.map is None:
        plugins = discovery()
        for role in roles:
            name = loaded.config.role_table(role).plugin
            if plugins.role(role, name).needs_map:
                raise ConfigError(f"--{role} {name}: needs a map, and an imported log has none: give --map WORLD")
    runner = _Runner(recording, loaded, roles, say)
    return runner.run()


class _Runner:
    """Steps the nodes on a log, tick by tick."""

    def __init__(self, recording: Recording, loaded: Loaded, roles: Sequence[str], say: Callable[[str], None]) -> None:
        self.recording, self.config = recording, loaded.config
        self.system = assemble(loaded, discovery())
        # Mappers and avoiders need poses, so that the localizer always steps.
        used = {"localizer", *roles}
        wanted = {(role, self.config.role_table(role).instance) for role in used}
        make_plugins(self.system, say, wanted)
        nodes = role_nodes(self.system, wanted)
        self.nodes = {role: FedNode(self.system.wiring[role, name], nodes[role, name]) for role, name in wanted}
        self.sensors = {
            spec.role: [given.name for given in spec.inputs if given.name.startswith("scan.")]
            for spec in self.system.specs
        }
        # Nodes correct the stamps that they read; here it is asked whether the track covers them.
        self.offsets_ns = {
            f"scan.{port.name}": port.offset_ns for spec in self.system.specs if spec.role == "platform"
            for port in spec.ports
        }  # fmt: skip
        system = self.system
        self.reference = ReferenceNode.of(self.config, system.robot, system.braking, system.goal_tolerance)
        self.result = LogReplay()
        if "avoider" in roles:
            name = self.config.avoider.instance
            self.result.avoider = Substitute(Disagreement("avoider", name))
        self.result.has_mapper = "mapper" in roles
        if "localizer" in roles:
            self.result.localizer = self.config.localizer.instance
            self.result.known = self.system.map
        self.track: list[PoseEstimate] = []
        self.estimates: list[PoseEstimate | None] = []
        self.taken = 0
        self.waiting: list[tuple[str, RangeScan | Sweep]] = []

    def run(self) -> LogReplay:
        """Step through the whole log."""
        # All poses first: an avoider's trajectory is what the driver did next.
        way = self._driven()
        period_ns = round(self.config.run.period * 1e9)
        first_ns = last_ns = 0
        for number, messages in self._ticks(period_ns):
            stamps = [message.envelope.stamp_ns for message in messages]
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
        """Messages by tick, in the order of receipt."""
        held: list[Recorded] = []
        number = -1
        for message in self.recording.messages(["platform/*/*"]):
            # Messages of a log may arrive late; a tick never goes back.
            tick = max(number, message.envelope.tick)
            if tick != number and held:
                yield number, held
                held = []
            number = tick
            held.append(message)
        if held:
            yield number, held

    def _driven(self) -> tuple[Floats, list[Any]]:
        """Stamps, ns, and poses of the whole log: the track that an avoider receives as its trajectory."""
        stamps, poses = [], []
        rows: list[tuple[float, ...]] = []
        scans: dict[str, list[Message]] = {name: [] for name in self.sensors["localizer"]}
        start = self.system.start
        odometry_to_map = np.array([start.x, start.y, start.heading])
        for message in self.recording.messages(["platform/*/*"]):
            name = f"scan.{message.key.rsplit('/', 1)[1]}"
            if name in scans:
                scans[name].append(message.message)
            if not isinstance(message.message, Odometry):
                continue
            estimate = self._localized(message, scans)
            self.estimates.append(estimate)
            if estimate is not None:
                stamps.append(message.envelope.stamp_ns)
                poses.append(estimate.pose)
                driven = message.message.pose
                seen = compose(odometry_to_map, np.array([driven.x, driven.y, driven.heading])).tolist()
                found = estimate.pose
                rows.append(((stamps[-1] - stamps[0]) * 1e-9, *seen, found.x, found.y, found.heading))
        if self.result.localizer:
            estimates = [estimate for estimate in self.estimates if estimate is not None]
            self.result.poses = LocalizerTrack(np.array(rows).reshape(-1, 7), estimates)
        self.driven_line = Polyline(np.array([(pose.x, pose.y) for pose in poses]).reshape(-1, 2))
        self._at: list[tuple[int, float, float]] = []
        return np.array(stamps, dtype=np.int64), poses

    def _localized(self, recorded: Recorded, scans: dict[str, list[Message]]) -> PoseEstimate | None:
        """The localizer's pose at an odometry message, from it and the scans since the last one, which are removed."""
        given: dict[str, Any] = {name: tuple(scan) for name, scan in scans.items()}
        for scan in scans.values():
            scan.clear()
        tick = Tick(recorded.envelope.tick, recorded.envelope.stamp_ns * 1e-9, recorded.envelope.stamp_ns, 0)
        outputs = self._step(self.nodes["localizer"], tick, given | {"odometry": recorded.message, "map": None})
        pose = dict(outputs).get("pose")
        return pose if isinstance(pose, PoseEstimate) else None

    def _take(self, tick: Tick, messages: Sequence[Recorded]) -> None:
        """Append the pose of every odometry message to the track, and queue the scans until poses cover them."""
        for message in messages:
            port = message.key.rsplit("/", 1)[1]
            if isinstance(message.message, Odometry):
                pose = self.estimates[self.taken]
                self.taken += 1
                # A track must rise, and some logs repeat stamps.
                if pose is not None and (not self.track or pose.stamp_ns > self.track[-1].stamp_ns):
                    self.track.append(pose)
            elif isinstance(message.message, (RangeScan, Sweep)):
                self.waiting.append((f"scan.{port}", message.message))
        del self.track[:-TRACK]

    def _covered(self) -> dict[str, list[Message]]:
        """Scans that the track now covers, by input. Scans from before the track's beginning are dropped."""
        ready: dict[str, list[Message]] = {}
        left = []
        for name, scan in self.waiting:
            offset_ns = self.offsets_ns[name]
            if not self.track or _end_ns(scan) + offset_ns > self.track[-1].stamp_ns:
                left.append((name, scan))
            elif scan.stamp_ns + offset_ns >= self.track[0].stamp_ns:
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
        driven = next(
            (message.message for message in reversed(messages) if isinstance(message.message, Odometry)), None
        )
        if driven is None:
            return
        pose = self.track[-1]
        reference = self._reference(pose, driven, int(np.searchsorted(way[0], pose.stamp_ns)))
        if reference is None:
            return
        scans: dict[str, list[Message]] = {name: [] for name in self.sensors["avoider"]}
        for message in messages:
            name = f"scan.{message.key.rsplit('/', 1)[1]}"
            if name in scans:
                scans[name].append(message.message)
        wanted = Command(driven.twist)
        given: dict[str, Any] = {"desired": wanted, **{name: tuple(scan) for name, scan in scans.items()}}
        outputs = dict(self._step(node, tick, given | {"pose": pose, "reference": reference}))
        result.steps += 1
        self._at.append((tick.number, pose.pose.x, pose.pose.y))
        if "command" in outputs:
            result.last = outputs["command"]
            found = differences("avoider", wanted, outputs["command"])
            result.found.add(tick.number, tick.time, DRIVER, found)

    def _reference(self, pose: PoseEstimate, driven: Odometry, place: int) -> Reference | None:
        """The remaining driven track in the form that the reference node publishes."""
        along = self.driven_line.along
        progress = float(along[min(place, len(along) - 1)])
        left = self.driven_line.length - progress
        # Without a way left an avoider stops, which would count as a difference.
        if left < ENDED:
            return None
        reach = min(self.reference.look_ahead, left)
        arcs = progress + np.append(np.arange(0.0, reach, WAY_STEP), reach)
        way = self.driven_line.at(arcs)
        target = Point2D(float(way[-1, 0]), float(way[-1, 1]))
        twist = driven.twist
        return Reference(
            1, progress, left, pose.pose, twist.vx, twist.wz, 0.0, target, way, self.reference.corridor, None
        )

    def _step(self, node: FedNode, tick: Tick, given: dict[str, Any]) -> list[tuple[str, Message]]:
        outputs = node.step(tick, given)
        if node.fault:
            self.result.faults.append(f"tick {tick.number}: {node.fault}")
        return outputs


def _end_ns(scan: RangeScan | Sweep) -> int:
    """Time of the last measurement of a scan, ns."""
    offsets = scan.frame_times if isinstance(scan, Sweep) else scan.time_offsets
    return scan.stamp_ns + (round(float(offsets.max()) * 1e9) if offsets.size else 0)
