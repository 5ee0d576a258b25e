"""Translates the messages of a navloom robot to ROS messages, for `navloom ros export` and `navloom ros serve`.

Frames follow REP 105: map, odom, base_link, and one for each sensor. It reads attributes of messages only and imports
no class of navloom, so that it can be tested and used without a recording.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom_ros.markers import avoider_markers
from navloom_ros.message_types import Types
from navloom_ros.times import time_of

__all__ = ["TOPICS", "Translated", "Translator"]

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
"""x, y, m, and heading, rad."""

TOPICS = {
    "/odom": "platform's odometry, with `/tf` odom → base_link",
    "/SENSOR": "a planar laser as LaserScan in a frame of its own, with `/tf_static`",
    "/SENSOR/beam_N": "each sonar of a ring as Range",
    "/SENSOR/points": "echoes of any other scanner, and sweeps, as PointCloud2 in base_link",
    "/SENSOR/kept": "points of a sweep that the mapper `ipabd` kept for the map, as PointCloud2 in base_link",
    "/pose": "localizer's pose with its covariance, with `/tf` map → odom",
    "/map": "mapper's raster; `/map/segments` its segments as a marker",
    "/plan": "planner's path; `/plan/traversable` its traversable grid, if there is one",
    "/avoider/markers": "costs, free slots, the chosen direction and the reason",
    "/local_plan": "the trajectory that is followed",
    "/cmd_vel": "the gate's command as TwistStamped; `/controller/cmd_vel` and `/avoider/cmd_vel` are the commands of "
    "these nodes",
    "/diagnostics": "the gate: which node drives, and why the robot stopped",
}
"""Topics of the translated messages, and what each has; the table in README.md."""
EVEN = 1e-6
"""Largest difference between the steps of the beams of a LaserScan, rad."""
_ARC = 1e-3
"""Half angle above which a beam is a sonar, rad."""
_OK, _WARN = 0, 1
_POINT_FIELDS = [("x", 0), ("y", 4), ("z", 8)]
_FLOAT32 = 7
_LINE_LIST = 5
_ULTRASOUND = 0


@dataclass(frozen=True)
class Translated:
    """A ROS message and its topic."""

    topic: str
    message: Any


@dataclass
class Translator:
    """Translates the messages of one robot in order. It stores the latest poses, mounts and active instances.

    Attributes:
        types: Types of the distribution that reads the result.
        offset_ns: Offset from the run clock to the stamps, ns.
        kept: Gives the (frames, beams) mask of the points of a sweep that the mapper kept; None if that is not known.
        left_out: Number of messages that were not translated, by role and port: without a counterpart, or not active.
    """

    types: Types
    offset_ns: int = 0
    kept: Callable[[Any], NDArray[np.bool_]] | None = None
    left_out: dict[str, int] = field(default_factory=dict)
    _active: dict[str, str] = field(default_factory=dict)
    _odometry: Pose = (0.0, 0.0, 0.0)
    _base: Pose = (0.0, 0.0, 0.0)
    _mounted: dict[str, Any] = field(default_factory=dict)

    def translate(self, role: str, instance: str, port: str, message: Any, stamp_ns: int) -> list[Translated]:
        """The ROS messages for a message; empty if it has no counterpart or its instance is not active.

        Args:
            role, instance, port: Of the message's stream.
            message: The message.
            stamp_ns: Its stamp on the run clock, ns.
        """
        kind = type(message).__name__
        if kind == "Selection":
            self._active.update(entry.split(" ", 1) for entry in message.instances)
        maker = _MAKERS.get((role, port)) or _BY_KIND.get(kind)
        # Until the first Selection, every instance counts as active.
        if maker is None or instance != self._active.get(role, instance):
            name = f"{role}/{port}"
            self.left_out[name] = self.left_out.get(name, 0) + 1
            return []
        stamp = self.header(stamp_ns, "")["stamp"]
        return list(maker(self, message, port, stamp))

    def header(self, stamp_ns: int, frame: str) -> dict[str, Any]:
        """Values of a header."""
        return {"stamp": time_of(stamp_ns + self.offset_ns), "frame_id": frame}

    def _made(self, topic: str, name: str, **values: Any) -> Translated:
        return Translated(topic, self.types.new(name, **values))

    def _transform(self, stamp: Any, parent: str, child: str, pose: Pose) -> Translated:
        return self._made("/tf", "tf2_msgs/msg/TFMessage", transforms=[_transform(stamp, parent, child, pose)])

    def _mount(self, stamp: Any, frame: str, pose: Pose) -> Iterator[Translated]:
        """All mounts so far if this one is new, because a late joiner of a latched topic gets only the last message."""
        if frame not in self._mounted:
            self._mounted[frame] = _transform(stamp, "base_link", frame, pose)
            yield self._made("/tf_static", "tf2_msgs/msg/TFMessage", transforms=list(self._mounted.values()))

    def _odom(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        self._odometry = _pose_of(message.pose)
        yield self._made(
            "/odom",
            "nav_msgs/msg/Odometry",
            header={"stamp": stamp, "frame_id": "odom"},
            child_frame_id="base_link",
            pose={"pose": _pose(self._odometry)},
            twist={"twist": _twist(message.twist)},
        )
        yield self._transform(stamp, "odom", "base_link", self._odometry)

    def _pose(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        base = self._base = _pose_of(message.pose)
        covariance = np.zeros((6, 6))
        # The order in ROS is x, y, z, roll, pitch, yaw.
        covariance[np.ix_((0, 1, 5), (0, 1, 5))] = message.covariance
        yield self._made(
            "/pose",
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            header={"stamp": stamp, "frame_id": "map"},
            pose={"pose": _pose(base), "covariance": covariance},
        )
        yield self._transform(stamp, "map", "odom", _map_to_odom(base, self._odometry))

    def _scan(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        bearings = np.unwrap(message.bearings)
        steps = np.diff(bearings)
        is_even = len(steps) > 0 and bool(np.ptp(steps) < EVEN) and bool(np.all(message.origins == message.origins[0]))
        if len(bearings) and np.all(message.half_angles > _ARC):
            yield from self._sonars(message, port, stamp)
        elif is_even and np.all(message.half_angles <= _ARC):
            yield from self._laser(message, port, stamp, bearings)
        else:
            yield self._echoes(message, port, stamp)

    def _laser(self, message: Any, port: str, stamp: Any, bearings: Floats) -> Iterator[Translated]:
        order = slice(None) if bearings[-1] >= bearings[0] else slice(None, None, -1)
        offsets = message.time_offsets[order]
        yield from self._mount(stamp, port, (float(message.origins[0, 0]), float(message.origins[0, 1]), 0.0))
        count = max(1, len(bearings) - 1)
        yield self._made(
            f"/{port}",
            "sensor_msgs/msg/LaserScan",
            header={"stamp": stamp, "frame_id": port},
            angle_min=float(bearings[order][0]),
            angle_max=float(bearings[order][-1]),
            angle_increment=float((bearings[order][-1] - bearings[order][0]) / count),
            time_increment=max(0.0, float(offsets[-1] - offsets[0]) / count),
            range_min=message.range_min,
            range_max=message.range_max,
            ranges=message.ranges[order],
        )

    def _sonars(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        for number, bearing in enumerate(message.bearings):
            frame = f"{port}_{number}"
            x, y = message.origins[number].tolist()
            yield from self._mount(stamp, frame, (x, y, float(bearing)))
            yield self._made(
                f"/{port}/beam_{number}",
                "sensor_msgs/msg/Range",
                header={"stamp": stamp, "frame_id": frame},
                radiation_type=_ULTRASOUND,
                field_of_view=2.0 * float(message.half_angles[number]),
                min_range=message.range_min,
                max_range=message.range_max,
                range=float(message.ranges[number]),
            )

    def _echoes(self, message: Any, port: str, stamp: Any) -> Translated:
        seen = message.ranges < message.range_max
        along = np.column_stack([np.cos(message.bearings), np.sin(message.bearings)])[seen]
        flat = message.origins[seen] + along * message.ranges[seen, None]
        return self._cloud(f"/{port}/points", stamp, np.column_stack([flat, np.zeros(len(flat))]))

    def _sweep(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        yield self._cloud(f"/{port}/points", stamp, _sweep_points(message, message.ranges < message.range_max))
        if self.kept is not None:
            yield self._cloud(f"/{port}/kept", stamp, _sweep_points(message, self.kept(message)))

    def _cloud(self, topic: str, stamp: Any, points: Floats) -> Translated:
        fields = [{"name": name, "offset": at, "datatype": _FLOAT32, "count": 1} for name, at in _POINT_FIELDS]
        return self._made(
            topic,
            "sensor_msgs/msg/PointCloud2",
            header={"stamp": stamp, "frame_id": "base_link"},
            height=1,
            width=len(points),
            fields=fields,
            point_step=12,
            row_step=12 * len(points),
            data=points.astype("<f4").tobytes(),
            is_dense=True,
        )

    def _map(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        header = {"stamp": stamp, "frame_id": "map"}
        yield self._grid("/map", stamp, message.grid)
        ends = message.segments.reshape(-1, 2)
        points = [{"x": x, "y": y} for x, y in ends.tolist()]
        look = {"scale": {"x": 0.03}, "color": {"r": 1.0, "g": 0.5, "a": 1.0}}
        marker = {"header": header, "ns": "segments", "type": _LINE_LIST, "points": points, **look}
        yield self._made("/map/segments", "visualization_msgs/msg/MarkerArray", markers=[marker])

    def _grid(self, topic: str, stamp: Any, grid: Any) -> Translated:
        header, (rows, columns) = {"stamp": stamp, "frame_id": "map"}, grid.cells.shape
        info = {"map_load_time": stamp, "resolution": grid.resolution, "width": columns, "height": rows,
                "origin": _pose(_pose_of(grid.origin))}  # fmt: skip
        return self._made(topic, "nav_msgs/msg/OccupancyGrid", header=header, info=info, data=grid.cells)

    def _avoider(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        if message.diagnostics is not None:
            header = {"stamp": stamp, "frame_id": "map"}
            markers = avoider_markers(header, message.diagnostics, message.status, self._base)
            yield self._made("/avoider/markers", "visualization_msgs/msg/MarkerArray", markers=markers)

    def _plan(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        if not hasattr(message, "points"):  # a plan failure
            return
        steps, headings = np.diff(message.points, axis=0), message.headings
        if headings is None:
            along = np.arctan2(steps[:, 1], steps[:, 0]) if len(steps) else np.zeros(1)
            headings = np.append(along, along[-1])[: len(message.points)]
        rows = np.column_stack([message.points, headings])
        yield self._path("/plan", stamp, rows)
        if message.traversable is not None:
            yield self._grid("/plan/traversable", stamp, message.traversable)

    def _trajectory(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        yield self._path("/local_plan", stamp, message.samples[:, 1:4])

    def _path(self, topic: str, stamp: Any, rows: Floats) -> Translated:
        header = {"stamp": stamp, "frame_id": "map"}
        poses = [{"header": header, "pose": _pose((x, y, heading))} for x, y, heading in rows.tolist()]
        return self._made(topic, "nav_msgs/msg/Path", header=header, poses=poses)

    def _command(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        yield self._velocity("/cmd_vel", message, stamp)

    def _asked_by_controller(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        yield self._velocity("/controller/cmd_vel", message, stamp)

    def _asked_by_avoider(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        yield self._velocity("/avoider/cmd_vel", message, stamp)

    def _velocity(self, topic: str, message: Any, stamp: Any) -> Translated:
        header = {"stamp": stamp, "frame_id": "base_link"}
        return self._made(topic, "geometry_msgs/msg/TwistStamped", header=header, twist=_twist(message.twist))

    def _gate(self, message: Any, port: str, stamp: Any) -> Iterator[Translated]:
        names = ("source", "instance", "latched", "limit", "share", "distance")
        is_braking = message.source == "none" and not message.stopped
        why = f"{'brakes' if is_braking else 'stopped'}: {message.reason}"
        status = {
            "level": _WARN if message.stopped else _OK,
            "name": "navloom: gate",
            "message": why if is_braking or message.stopped else f"{message.source} drives",
            "values": [{"key": name, "value": str(getattr(message, name))} for name in names],
        }
        header = {"stamp": stamp, "frame_id": ""}
        yield self._made("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status])


Maker = Callable[[Translator, Any, str, Any], Iterator[Translated]]
_MAKERS: dict[tuple[str, str], Maker] = {
    ("platform", "odometry"): Translator._odom,
    ("localizer", "pose"): Translator._pose,
    ("mapper", "map"): Translator._map,
    ("planner", "path"): Translator._plan,
    ("reference", "trajectory"): Translator._trajectory,
    ("gate", "command"): Translator._command,
    ("controller", "command"): Translator._asked_by_controller,
    ("avoider", "command"): Translator._asked_by_avoider,
    ("gate", "status"): Translator._gate,
    ("avoider", "status"): Translator._avoider,
}
"""Methods that translate the streams, by role and port."""
_BY_KIND: dict[str, Maker] = {"RangeScan": Translator._scan, "Sweep": Translator._sweep}
"""Methods that translate sensor messages, by class: the ports of sensors have any name."""


def _sweep_points(sweep: Any, chosen: NDArray[np.bool_]) -> Floats:
    """The chosen echoes of a sweep of a pitched planar laser, (n, 3), m, base frame; `chosen` is (frames, beams).

    "paper": r cosα about the vertical (Hoang et al. 2013, eq. (1)). "rigid_pitch": the scan plane tilted as a whole.
    """
    pitch, bearing = sweep.pitches[:, None], sweep.bearings[None, :]
    if sweep.geometry == "paper":
        factors = (np.cos(pitch) * np.cos(bearing), np.cos(pitch) * np.sin(bearing), np.sin(pitch) + 0.0 * bearing)
    else:
        factors = (np.cos(bearing) * np.cos(pitch), np.sin(bearing) + 0.0 * pitch, np.cos(bearing) * np.sin(pitch))
    points: Floats = np.column_stack([sweep.ranges[chosen] * factor[chosen] for factor in factors])
    points += (sweep.x, sweep.y, sweep.z)
    return points


def _map_to_odom(base_in_map: Pose, base_in_odom: Pose) -> Pose:
    """Pose of the odometry frame in the map: map_T_base · (odom_T_base)⁻¹."""
    heading = math.remainder(base_in_map[2] - base_in_odom[2], math.tau)
    cos, sin = math.cos(heading), math.sin(heading)
    x = base_in_map[0] - cos * base_in_odom[0] + sin * base_in_odom[1]
    y = base_in_map[1] - sin * base_in_odom[0] - cos * base_in_odom[1]
    return x, y, heading


def _transform(stamp: Any, parent: str, child: str, pose: Pose) -> dict[str, Any]:
    x, y, heading = pose
    transform = {"translation": {"x": x, "y": y}, "rotation": _rotation(heading)}
    return {"header": {"stamp": stamp, "frame_id": parent}, "child_frame_id": child, "transform": transform}


def _pose_of(pose: Any) -> Pose:
    return float(pose.x), float(pose.y), float(pose.heading)


def _pose(pose: Pose) -> dict[str, Any]:
    return {"position": {"x": pose[0], "y": pose[1]}, "orientation": _rotation(pose[2])}


def _rotation(heading: float) -> dict[str, float]:
    return {"z": math.sin(heading / 2.0), "w": math.cos(heading / 2.0)}


def _twist(twist: Any) -> dict[str, Any]:
    return {"linear": {"x": twist.vx, "y": twist.vy}, "angular": {"z": twist.wz}}
