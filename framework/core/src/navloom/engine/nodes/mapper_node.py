"""The node around a mapper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from navloom.engine.answer_checks import MapperDoor
from navloom.engine.node_ports import New, OtherSensors, Output, Sensors, Track
from navloom.engine.nodes.node_base import Tick
from navloom.engine.nodes.role_node import RANGES, RoleNode, in_order, of_kind, readings_of
from navloom.engine.streams import GoalPorts, LocalizerPorts, MapperPorts, PlatformPorts
from navloom.messages import OccupancyGrid, PoseEstimate, PoseTrack, RangeScan, Sweep
from navloom.roles import Mapper, MapperInput

__all__ = ["MapperNode"]

BEFORE_DATA_NS = 500_000_000
"""How far a mapper's track of poses reaches back before its oldest data, ns."""


class MapperNode(RoleNode[Mapper]):
    """Turns range data and the poses of the same time into a map."""

    role = "mapper"
    patience = 1.0  # no node waits for a map, and on a slow link the poses of a sweep can arrive after it
    scans = Sensors(RANGES, triggers=True, otherwise=PlatformPorts.odometry)
    readings = OtherSensors(RANGES, triggers=True)
    track = Track(LocalizerPorts.pose)
    clear = New(GoalPorts.clear, delayed=True, triggers=True)
    known = Output(MapperPorts.known)
    map = Output(MapperPorts.map)
    cause = track

    def __init__(self, plugin: Mapper) -> None:
        self.plugin = plugin
        self.door = MapperDoor(plugin)
        self._known: OccupancyGrid | None = None
        self._is_to_clear = False

    def clear_soon(self) -> None:
        """Clear the map in the next step, for a tool; a recording of a live robot does not contain this."""
        self._is_to_clear = True

    def step(self, tick: Tick) -> None:
        data, names = in_order(self.scans)
        named = list(zip(data, names, strict=True))
        sweeps, sweep_sensors = of_kind(Sweep, named)
        scans, sensors = of_kind(RangeScan, named)
        poses = self.track.values
        track = _covering(poses, min((message.stamp_ns for message in data), default=tick.time_ns))
        seen = MapperInput(
            tick.time_ns,
            sweeps,
            scans,
            track,
            # However many requests came, there is one map to clear.
            bool(self.clear.values) or self._is_to_clear,
            sensors,
            sweep_sensors,
            readings_of(self.readings),
            self.extra(),
            not poses or poses[-1].state == "tracking",
        )
        self._is_to_clear = False
        update = self.door.check(self.plugin.update(seen), seen)
        known = self.plugin.known()
        # By identity: the plugin returns the same grid until it changes.
        if known is not None and known is not self._known:
            self._known = known
            self.known.put(known)
        if update is not None:
            self.map.put(update)


def _covering(poses: Sequence[PoseEstimate], since_ns: int) -> PoseTrack:
    """The newest part of a track, from a little before the oldest data: a mapper does not need the older poses."""
    begin_ns = since_ns - BEFORE_DATA_NS
    kept: list[PoseEstimate] = []
    # From the newest: the track holds minutes, and a step needs about a second of it.
    for pose in reversed(poses):
        # Including the one before the beginning, so that poses can be interpolated there.
        kept.append(pose)
        if pose.stamp_ns <= begin_ns:
            break
    kept.reverse()
    numbers: list[float] = []
    for pose in kept:
        numbers += (pose.pose.x, pose.pose.y, pose.pose.heading)
    return PoseTrack(
        np.array([pose.stamp_ns for pose in kept], dtype=np.int64),
        np.array(numbers, dtype=np.float64).reshape(-1, 3),
    )
