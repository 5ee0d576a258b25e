"""Simulates a base on a pseudo-terminal, with inertia of its wheels: python examples/serial_base/play_base.py PORT.

PORT is the path that the driver opens: the script creates it as a link to the pseudo-terminal. Type a fault and Enter:
unplug, plug, mute (sends nothing), stuck (its firmware hangs), garbage, half (truncated frames), press, release (its
emergency stop), bump, fine.
"""

import math
import os
import pty
import random
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from serial_protocol import BUMPER, EMERGENCY_STOP, STOPPED_ITSELF, WATCHDOG, Frames, Status, speeds_of, status

STEP = 0.005
"""Step of the simulation, s."""
PERIOD = 0.02
"""Interval of the statuses, s."""
ACCELERATION = 3.0
"""Largest acceleration of a wheel, m/s²."""
TICKS_PER_METRE = 1024 / (math.tau * 0.05)
"""Encoder ticks per metre: 1024 in one turn of a wheel with a radius of 0.05 m."""


class PlayedBase:
    """A simulated base whose wheels accelerate by at most `ACCELERATION`, m/s², and stop without commands.

    Attributes:
        fault: "", "mute", "stuck", "garbage" or "half".
        flags: Status flags that a person or a wall sets.
        wanted: Target speeds of its wheels, m/s.
        wheels: Speeds of its wheels, m/s.
        stopped_at: Time at which the target speeds became zero, s, monotonic; infinite while they are not.
    """

    def __init__(self, port: Path) -> None:
        self.port, self.fault, self.flags = port, "", 0
        self.wanted = self.wheels = (0.0, 0.0)
        self.stopped_at = time.monotonic()
        self._way = [0.0, 0.0]
        self._frames, self._random = Frames(), random.Random(1)
        self._lock, self._ends = threading.Lock(), threading.Event()
        self._master = -1
        self._switched_on = self._fed = time.monotonic()
        self.plug()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def plug(self) -> None:
        """Create the port."""
        with self._lock:
            if self.port.is_symlink():  # left by an earlier run; any other file is kept
                self.port.unlink()
            self._master, other = pty.openpty()
            os.set_blocking(self._master, False)
            self.port.symlink_to(os.ttyname(other))
            os.close(other)

    def unplug(self) -> None:
        """Pull the cable: the port disappears, and the base continues on its own."""
        with self._lock:
            self.port.unlink(missing_ok=True)
            os.close(self._master)
            self._master = -1

    def reboot(self) -> None:
        """Restart time and tick counts from zero."""
        with self._lock:
            self._switched_on, self._way = time.monotonic(), [0.0, 0.0]

    def close(self) -> None:
        """Stop the thread and remove the port."""
        self._ends.set()
        self._thread.join()
        if self._master >= 0:
            self.unplug()

    def _run(self) -> None:
        told = last = time.monotonic()
        while not self._ends.wait(STEP):
            with self._lock:
                now = time.monotonic()
                self._obey(now)
                self._move(now - last)
                last = now
                if now - told >= PERIOD:
                    told = now
                    self._tell(now)

    def _obey(self, now: float) -> None:
        data = b""
        if self._master >= 0 and self.fault != "stuck":
            with suppress(OSError):  # no process has the port open
                data = os.read(self._master, 65536)
        for body in self._frames.take(data):
            speeds = speeds_of(body)
            if speeds is not None:
                self._fed, self.wanted = now, speeds
        if now - self._fed > WATCHDOG or self.flags & EMERGENCY_STOP:
            self.wanted = (0.0, 0.0)
        if self.wanted != (0.0, 0.0):
            self.stopped_at = math.inf
        elif self.stopped_at == math.inf:
            self.stopped_at = now

    def _move(self, seconds: float) -> None:
        most = ACCELERATION * seconds
        self.wheels = tuple(
            speed + max(-most, min(most, wanted - speed))
            for speed, wanted in zip(self.wheels, self.wanted, strict=True)
        )
        for side, speed in enumerate(self.wheels):
            self._way[side] += speed * seconds

    def _tell(self, now: float) -> None:
        if self._master < 0 or self.fault in ("mute", "stuck"):
            return
        uptime_ms = round(1000.0 * (now - self._switched_on))
        stopped_itself = STOPPED_ITSELF if now - self._fed > WATCHDOG else 0
        left, right = (round(way * TICKS_PER_METRE) for way in self._way)
        data = status(Status(uptime_ms, left, right, self.flags | stopped_itself, 24_000))
        if self.fault == "garbage":
            data = self._random.randbytes(len(data))
        elif self.fault == "half":
            # without its checksum: a frame that lacks one byte is whole if the next frame begins with that byte
            data = data[: self._random.randrange(1, len(data) - 2)]
        with suppress(OSError):  # no process reads the port or has it open
            os.write(self._master, data)


def main() -> None:
    """Simulate a base until the input ends, with the faults that are typed."""
    if len(sys.argv) != 2:
        sys.exit("expected PORT, the name that the driver opens: python examples/serial_base/play_base.py ~/base")
    try:
        base = PlayedBase(Path(sys.argv[1]))
    except OSError as error:
        sys.exit(f"{sys.argv[1]}: no port can be made there: {error.strerror}")
    print(f"a base is at {base.port}", flush=True)
    for line in sys.stdin:
        word = line.strip()
        if word in ("plug", "unplug"):
            (base.plug if word == "plug" else base.unplug)()
        elif word in ("press", "release", "bump"):
            base.flags = {"press": EMERGENCY_STOP, "release": 0, "bump": BUMPER}[word]
        else:
            base.fault = "" if word == "fine" else word
        print(f"{word}: wheels at {base.wheels[0]:.2f} and {base.wheels[1]:.2f} m/s", flush=True)
    base.close()


if __name__ == "__main__":
    main()
