"""A process of its own that stops the base when the process of the platform dies or freezes.

It has a session of its own with the robot's router. The platform writes a line to it with each tick; where the lines
end, or cease while the robot moves, it publishes zero.
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

__all__ = ["Guard", "velocity"]

BETWEEN = 0.02
"""s between two zeros."""
AFTER = 1.0
"""s for which zero is published once the platform's process has ended."""
AGAIN = 1.0
"""s between two tries to join the network."""
UNHEARD = 1.0
"""s without a sign of the guardian after which it counts as frozen."""
READY, BEAT = b"r", b"b"
MOVING, STOPPED = "m", "s"


def velocity(types: Types, stamped: bool, vx: float, vy: float, wz: float, frame: str, stamp_ns: int | None) -> Any:
    """A Twist, or a TwistStamped with a stamp of the robot's clock; without one, 0, which ROS takes for now."""
    twist = {"linear": {"x": vx, "y": vy}, "angular": {"z": wz}}
    if not stamped:
        return types.new("geometry_msgs/msg/Twist", **twist)
    seconds, nanoseconds = divmod(stamp_ns or 0, 1_000_000_000)
    header = {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame}
    return types.new("geometry_msgs/msg/TwistStamped", header=header, twist=twist)


class Guard:
    """The platform's end of it: starts the process and tells it that the platform lives.

    Args:
        given: What `main` needs, as JSON has it.
    """

    def __init__(self, given: Mapping[str, Any]) -> None:
        command = [sys.executable, "-c", f"from {__name__} import main; main()", json.dumps(dict(given))]
        # Nothing of the environment: the guardian outlives the robot's processes by a second, and whoever ends what
        # those have started must not end it before it has stopped the base.
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={"PYTHONPATH": os.pathsep.join(sys.path)},
            start_new_session=True,
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._to, self._from = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._to, False)
        os.set_blocking(self._from, False)
        self.is_ready = False
        self._heard_ns = time.monotonic_ns()

    @property
    def is_alive(self) -> bool:
        """It runs, and answers; also while it starts."""
        said = b""
        with suppress(BlockingIOError):
            said = os.read(self._from, 4096)
        if said:
            self._heard_ns = time.monotonic_ns()
            self.is_ready = True
        is_heard = not self.is_ready or time.monotonic_ns() - self._heard_ns < UNHEARD * 1e9
        return self._process.poll() is None and is_heard

    def beat(self, is_moving: bool, stamp_ns: int | None) -> None:
        """Say that the platform lives, whether the base may move, and the time on the robot's clock."""
        with suppress(BlockingIOError, BrokenPipeError):
            os.write(self._to, f"{MOVING if is_moving else STOPPED} {stamp_ns or 0}\n".encode())

    def close(self, is_frozen: bool = False) -> None:
        """Let it stop the base and end; it does so by itself when this process ends. A frozen one is killed."""
        if is_frozen:
            self._process.kill()
        for stream in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                assert stream is not None
                stream.close()
        if is_frozen:
            self._process.wait()


def main() -> None:
    """Run in the guardian's process, with what `Guard` was given as JSON in the first argument."""
    given = json.loads(sys.argv[1])
    given_network = given["network"]
    network = Network(**{**given_network, "folders": tuple(map(Path, given_network["folders"]))})
    types = network.types()
    kind = "geometry_msgs/msg/TwistStamped" if given["stamped"] else "geometry_msgs/msg/Twist"
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
    """Publish zero while the platform is silent and the base may move; end some time after the platform has."""
    is_moving, ended_at, text = False, None, b""
    stamp_ns, heard = 0, time.monotonic()
    while ended_at is None or time.monotonic() - ended_at < AFTER:
        due = BETWEEN if ended_at is not None else max(BETWEEN, heard + silence - time.monotonic())
        if ended_at is not None:
            time.sleep(BETWEEN)
        elif select.select([0], [], [], due)[0]:
            read = os.read(0, 65536)
            text, heard = text + read, time.monotonic()
            *lines, text = text.split(b"\n")
            if lines:
                mode, stamp = lines[-1].decode().split()
                is_moving, stamp_ns = mode == MOVING, int(stamp)
                with suppress(OSError):
                    os.write(1, BEAT)
            if not read:
                ended_at = heard
        now = time.monotonic()
        if ended_at is not None or (is_moving and now - heard >= silence):
            stop(stamp_ns + round((now - heard) * 1e9) if stamp_ns else 0)


def _is_over(seconds: float) -> bool:
    """Wait, at most so long; whether the platform's process has ended."""
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0.0:
        if select.select([0], [], [], left)[0] and not os.read(0, 65536):
            return True
    return False
