"""Serves a robot's messages to Foxglove and Lichtblick, in the frames map, odom and base_link, over a local socket."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from navloom.geometry.echoes import scan_points
from navloom.messages import (
    Command,
    GateStatus,
    MapUpdate,
    Odometry,
    Path,
    Pose2D,
    PoseEstimate,
    RangeScan,
    Trajectory,
)
from numpy.typing import NDArray

from navloom_viewer.drawing import Shown
from navloom_viewer.viewer_errors import ViewerError

__all__ = ["FoxgloveServer"]

Floats = NDArray[np.float64]
# These change seldom, so a program that joins later would show nothing of them for a long time.
KEPT = frozenset({"/map", "/plan", "/trajectory", "/gate"})
"""Topics whose last message is sent to each program that joins."""
MOST_POSES = 200
"""Most poses of a line; longer lines are thinned."""


class FoxgloveServer:
    """Serves the messages of active instances. A slow program loses the oldest messages and delays nothing.

    Args:
        name: Displayed name of the robot.
        host, port: Address to listen at; port 0 takes a free one.

    Raises:
        ViewerError: The package is not installed, or the server cannot listen at the address.
    """

    def __init__(self, name: str, host: str, port: int) -> None:
        try:
            import foxglove
            from foxglove import messages
        # An optional extra: robots and CI that draw nothing do not have to install it.
        except ImportError:
            raise ViewerError(
                "--foxglove needs the extra `foxglove`: uv sync --group foxglove, or pip install 'navloom[foxglove]'"
            ) from None
        repeat = self._repeat

        # Defined here since its base class exists only where the extra is installed; mypy sees `Any` as the base.
        class Greeter(foxglove.ServerListener):  # type: ignore[misc,name-defined]
            """Receives each new subscription of a program, on a thread of the server."""

            def on_subscribe(self, client: Any, channel: Any) -> None:
                repeat(channel.topic)

        self._messages: Any = messages
        # A context of its own, not the global one, so two servers in one process do not share channels.
        self._context = foxglove.Context()
        self._channels: dict[str, Any] = {}
        self._odom: Pose2D | None = None
        self._kept: dict[str, tuple[Any, int]] = {}
        try:
            self._server = foxglove.start_server(
                name=name, host=host, port=port, context=self._context, server_listener=Greeter()
            )
        except (OSError, RuntimeError) as error:
            raise ViewerError(f"--foxglove {host}:{port}: cannot be listened at: {error}") from None
        # The server's port, since port 0 stands for any free one.
        self.address = f"ws://{host}:{self._server.port}"

    def put(self, shown: Shown) -> None:
        """Send a message if its instance is active and there is a display for it."""
        # Foxglove has one topic per port, so a comparison instance would draw over the active one.
        if not shown.active:
            return
        message, at = shown.message, shown.stamp_ns
        if isinstance(message, Odometry):
            self._odom = message.pose
            self._transform("odom", "base_link", message.pose, at)
        elif isinstance(message, PoseEstimate):
            self._locate(message.pose, at)
        elif isinstance(message, RangeScan):
            self._cloud(f"/{shown.port}", message, at)
        elif isinstance(message, MapUpdate):
            self._map(message, at)
        elif isinstance(message, Path):
            self._line("/plan", message.points, at)
        elif isinstance(message, Trajectory):
            self._line("/trajectory", message.samples[:, 1:3], at)
        # Only what the robot is told; the commands of avoiders and recoveries have the same type.
        elif isinstance(message, Command) and shown.role == "gate":
            twist = message.twist
            self._json("/command", {"vx": twist.vx, "vy": twist.vy, "wz": twist.wz}, at)
        elif isinstance(message, GateStatus):
            said = f"{message.source} {message.instance} drives"
            # Without a source the gate brakes too, though nobody has stopped the robot.
            if message.stopped or message.source == "none":
                said = f"{'stopped' if message.stopped else 'brakes'}: {message.reason}"
            level = self._messages.LogLevel.Warning if message.stopped else self._messages.LogLevel.Info
            self._log("/gate", "Log", at, level=level, message=said, name="gate")

    def close(self) -> None:
        """Stop the server and disconnect its programs."""
        self._server.stop()

    def _log(self, topic: str, kind: str, at: int, **values: Any) -> None:
        """Send a message of a Foxglove schema."""
        import foxglove.channels

        if topic not in self._channels:
            self._channels[topic] = getattr(foxglove.channels, f"{kind}Channel")(topic, context=self._context)
        stamp = self._messages.Timestamp(at // 1_000_000_000, at % 1_000_000_000)
        made = getattr(self._messages, kind)(timestamp=stamp, **values)
        if topic in KEPT:
            self._kept[topic] = made, at
        self._channels[topic].log(made, log_time=at)

    def _repeat(self, topic: str) -> None:
        """Send the last message of a rarely published topic to late joiners."""
        kept = self._kept.get(topic)
        if kept is not None:
            self._channels[topic].log(kept[0], log_time=kept[1])

    def _json(self, topic: str, values: dict[str, float], at: int) -> None:
        """Send numbers for plots."""
        import foxglove

        if topic not in self._channels:
            self._channels[topic] = foxglove.Channel(topic, message_encoding="json", context=self._context)
        self._channels[topic].log(values, log_time=at)

    def _transform(self, parent: str, child: str, pose: Pose2D, at: int) -> None:
        place, turn = self._place(pose)
        self._log(f"/tf/{child}", "FrameTransform", at, parent_frame_id=parent, child_frame_id=child,
                  translation=place, rotation=turn)  # fmt: skip

    def _locate(self, pose: Pose2D, at: int) -> None:
        """Send the odometry frame's pose in the map: the localizer's pose times the inverse of the odometry pose."""
        self._log("/pose", "PoseInFrame", at, frame_id="map", pose=self._pose(pose))
        if self._odom is None:
            return
        # map → odom is what is published, not map → base_link: a frame has one parent, and base_link's is odom.
        turn = math.remainder(pose.heading - self._odom.heading, math.tau)
        x = pose.x - math.cos(turn) * self._odom.x + math.sin(turn) * self._odom.y
        y = pose.y - math.sin(turn) * self._odom.x - math.cos(turn) * self._odom.y
        self._transform("map", "odom", Pose2D(x, y, turn), at)

    def _cloud(self, topic: str, scan: RangeScan, at: int) -> None:
        flat = scan_points(scan)
        # Little-endian whatever the host: the schema fixes the byte order. z stays 0, since scans are planar.
        points = np.zeros((len(flat), 3), dtype="<f4")
        points[:, :2] = flat
        number = self._messages.PackedElementFieldNumericType.Float32
        fields = [self._messages.PackedElementField(name=name, offset=4 * place, type=number)
                  for place, name in enumerate("xyz")]  # fmt: skip
        self._log(topic, "PointCloud", at, frame_id="base_link", pose=self._pose(Pose2D(0.0, 0.0, 0.0)),
                  point_stride=12, fields=fields, data=points.tobytes())  # fmt: skip

    def _map(self, update: MapUpdate, at: int) -> None:
        """Send a map: free white, occupied black, unknown transparent."""
        grid = update.grid
        shade = (255 - np.clip(grid.cells, 0, 100).astype(np.int32) * 255 // 100).astype(np.uint8)
        pixels = np.stack([shade, shade, shade, np.where(grid.cells < 0, 0, 255).astype(np.uint8)], axis=-1)
        number = self._messages.PackedElementFieldNumericType.Uint8
        fields = [self._messages.PackedElementField(name=name, offset=place, type=number)
                  for place, name in enumerate(("red", "green", "blue", "alpha"))]  # fmt: skip
        size = self._messages.Vector2(x=grid.resolution, y=grid.resolution)
        self._log("/map", "Grid", at, frame_id="map", pose=self._pose(grid.origin), column_count=grid.cells.shape[1],
                  cell_size=size, row_stride=4 * grid.cells.shape[1], cell_stride=4, fields=fields,
                  data=pixels.tobytes())  # fmt: skip

    def _line(self, topic: str, points: Floats, at: int) -> None:
        # Each pose is an object made in Python, so a long plan costs time.
        thinned = points[:: max(1, math.ceil(len(points) / MOST_POSES))]
        poses = [self._pose(Pose2D(float(x), float(y), 0.0)) for x, y in thinned]
        self._log(topic, "PosesInFrame", at, frame_id="map", poses=poses)

    def _pose(self, pose: Pose2D) -> Any:
        place, turn = self._place(pose)
        return self._messages.Pose(position=place, orientation=turn)

    def _place(self, pose: Pose2D) -> tuple[Any, Any]:
        """Translation and rotation."""
        half = pose.heading / 2.0
        turn = self._messages.Quaternion(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
        return self._messages.Vector3(x=pose.x, y=pose.y, z=0.0), turn
