"""The guardian: a separate process that stops the base when the platform's process dies or freezes.

It has its own session with the robot's router. The platform writes one line to its stdin in each tick. When the pipe
closes, or no line arrives while the robot moves, the guardian publishes zero velocity. `Guard` is the platform's end of
the pipe, used by `link`; `main` runs in the guardian's process.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from navloom_ros.errors import RosError
from navloom_ros.joining import Network
from navloom_ros.message_types import Types
from navloom_ros.qos import DEFAULT
from navloom_ros.times import time_of

__all__ = ["Guard", "velocity"]

BETWEEN = 0.02
"""Interval between two zero velocities, s."""
AFTER = 1.0
"""How long zero is published after the platform's process has ended, s."""
AGAIN = 1.0
"""Interval between two attempts to join the network, s."""
UNHEARD = 1.0
"""Time without an answer from the guardian after which it counts as frozen, s."""
READY, BEAT = b"r", b"b"
MOVING, STOPPED = "m", "s"


def velocity(types: Types, stamped: bool, vx: float, vy: float, wz: float, frame: str, stamp_ns: int | None) -> Any:
    """A Twist, or a TwistStamped.

    Args:
        types: Of the robot's distribution.
        stamped: Make a TwistStamped.
        vx, vy, wz: Velocity in the base frame, m/s and rad/s.
        frame: Of the TwistStamped.
        stamp_ns: On the robot's clock; None becomes 0, which ROS reads as "now".
    """
    twist = {"linear": {"x": vx, "y": vy}, "angular": {"z": wz}}
    if not stamped:
        return types.new("geometry_msgs/msg/Twist", **twist)
    header = {"stamp": time_of(stamp_ns or 0), "frame_id": frame}
    return types.new("geometry_msgs/msg/TwistStamped", header=header, twist=twist)


class Guard:
    """The platform's end of the guardian: starts its process and sends it a heartbeat.

    Args:
        given: Settings for `main`, of types that JSON has (`Settings.for_guardian`).
    """

    def __init__(self, given: Mapping[str, Any]) -> None:
        command = [sys.executable, "-c", f"from {__name__} import main; main()", json.dumps(dict(given))]
        # An empty environment: the framework finds leftover processes of a robot by a mark in their environment. It
        # must not end the guardian, which outlives the platform by a second, before the base is stopped.
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={"PYTHONPATH": os.pathsep.join(sys.path)},
            start_new_session=True,
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._to, self._from = self._process.stdin.fileno(), self._process.stdout.fileno()
        # A frozen guardian must not freeze the platform, which writes to it in each tick.
        os.set_blocking(self._to, False)
        os.set_blocking(self._from, False)
        self.is_ready = False
        self._heard_ns = time.monotonic_ns()

    @property
    def is_alive(self) -> bool:
        """The process runs and answers. Also true while it starts."""
        said = b""
        with suppress(BlockingIOError):
            said = os.read(self._from, 4096)
        if said:
            self._heard_ns = time.monotonic_ns()
            self.is_ready = True
        is_heard = not self.is_ready or time.monotonic_ns() - self._heard_ns < UNHEARD * 1e9
        return self._process.poll() is None and is_heard

    def beat(self, is_moving: bool, stamp_ns: int | None) -> None:
        """Send the heartbeat.

        Args:
            is_moving: The last velocity was not zero.
            stamp_ns: Time on the robot's clock; None if that is unknown.
        """
        with suppress(BlockingIOError, BrokenPipeError):
            os.write(self._to, f"{MOVING if is_moving else STOPPED} {stamp_ns or 0}\n".encode())

    def close(self, is_frozen: bool = False) -> None:
        """Let the guardian stop the base and exit, as it also does when this process ends. A frozen one is killed."""
        if is_frozen:
            self._process.kill()
        for stream in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                assert stream is not None
                stream.close()
        if is_frozen:
            self._process.wait()


def main() -> None:
    """Run the guardian's process. Its first argument is the settings of `Guard` as JSON."""
    given = json.loads(sys.argv[1])
    given_network = given["network"]
    network = Network(**{**given_network, "folders": tuple(map(Path, given_network["folders"]))})
    types = network.types()
    kind = "geometry_msgs/msg/TwistStamped" if given["stamped"] else "geometry_msgs/msg/Twist"
    # The router may come up after the robot's processes.
    while True:
        try:
            node = network.join(types)
            break
        except RosError:
            if _is_over(AGAIN):
                return
    with node:
        publisher = node.publisher(given["command"], kind, DEFAULT)

        def stop(stamp_ns: int) -> None:
            publisher.publish(velocity(types, given["stamped"], 0.0, 0.0, 0.0, given["frame"], stamp_ns or None))

        with suppress(BrokenPipeError):
            os.write(1, READY)
        _guard(stop, given["silence"])


def _guard(stop: Any, silence: float) -> None:
    """Publish zero velocity while the platform is silent and the base may move, and for `AFTER` s once it has ended.

    Args:
        stop: Publishes zero velocity with a stamp, ns; 0 for none.
        silence: Time without a heartbeat after which the platform counts as frozen, s.
    """
    is_moving, ended_at, text = False, None, b""
    stamp_ns, heard = 0, time.monotonic()
    while ended_at is None or time.monotonic() - ended_at < AFTER:
        due = BETWEEN if ended_at is not None else max(BETWEEN, heard + silence - time.monotonic())
        if ended_at is not None:
            time.sleep(BETWEEN)
        elif select.select([0], [], [], due)[0]:
            read = os.read(0, 65536)
            text, heard = text + read, time.monotonic()
            # A read may end within a line.
            *lines, text = text.split(b"\n")
            if lines:
                # Only the newest heartbeat counts.
                mode, stamp = lines[-1].decode().split()
                is_moving, stamp_ns = mode == MOVING, int(stamp)
                with suppress(OSError):
                    os.write(1, BEAT)
            if not read:
                ended_at = heard
        now = time.monotonic()
        if ended_at is not None or (is_moving and now - heard >= silence):
            # The robot's clock is extrapolated: a base may refuse commands with an old stamp.
            stop(stamp_ns + round((now - heard) * 1e9) if stamp_ns else 0)


def _is_over(seconds: float) -> bool:
    """Whether the platform's process ends within some seconds; waits that long at most."""
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0.0:
        if select.select([0], [], [], left)[0] and not os.read(0, 65536):
            return True
    return False
