"""A differential-drive base on a serial line: the example of docs/writing-a-driver.md.

The link's thread reads the base and repeats the speeds every 20 ms, which feeds the base's own watchdog. It sends zero
if the base has been silent for `silence`, or if `drive` has not been called for `silence` plus one tick.
"""

import math
import threading
import time
from contextlib import suppress

from navloom import (
    Contact,
    Context,
    Odometry,
    Params,
    Platform,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    Registry,
    Twist2D,
    hookimpl,
)
from navloom.drivers.clocks import ClockOffset
from navloom.drivers.link import DriverError, Link
from navloom.drivers.ports import SerialPort
from pydantic import Field
from serial_protocol import BUMPER, EMERGENCY_STOP, TICKS, Frames, Status, signed, speeds, status_of

BEAT = 0.02
"""Interval at which the speeds are repeated, s."""
FIRST_STATUS = 1.0
"""Longest wait for the first status of the base, s."""


class SerialBaseParams(Params):
    """Connection, encoders and timeout of the base."""

    port: str = Field(description="Serial port, as /dev/serial/by-id/usb-….")
    baud: int = Field(115200, ge=300, description="Bits per second.")
    ticks_per_turn: int = Field(1024, ge=1, description="Ticks of an encoder in one turn of its wheel.")
    silence: float = Field(0.08, ge=0.03, le=1.0, description="Time without a status after which the robot stops, s.")


class SerialBase(Platform[SerialBaseParams]):
    """Drives the base and computes odometry from its encoders."""

    name = "serial_base"

    def __init__(self, params: SerialBaseParams, context: Context) -> None:
        super().__init__(params, context)
        self._frames = Frames()
        self._lock = threading.Lock()  # guards all attributes below, which both threads use
        self._heard = threading.Event()
        self._status: Status | None = None
        self._heard_at = self._asked_at = -math.inf  # s, monotonic
        self._wheels = (0.0, 0.0)
        self._pose, self._twist = Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)
        self._measured_ns = 0  # time of the pose, monotonic
        self._run_to_local = ClockOffset()
        self._base_clock = ClockOffset(modulus_ns=TICKS * 1_000_000)
        self._stamp_ns = 0
        self._link = Link(
            f"base at {params.port}",
            lambda: SerialPort(params.port, params.baud),
            self._received,
            opened=self._opened,
            beat=self._beat,
            beat_period=BEAT,
            silence=0.5,
        )

    def drive(self, command: Twist2D, time_ns: int) -> None:
        """Send a velocity to the wheels now; the link's thread repeats it with every beat."""
        turn = command.wz * self.context.robot.half_track
        with self._lock:
            self._wheels, self._asked_at = (command.vx - turn, command.vx + turn), time.monotonic()
        self._start()
        if not self._refusal():
            self._link.write(speeds(*self._wheels))

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Odometry and contact from the newest status. Raises DriverError while the base cannot be driven."""
        if self._start():
            self._heard.wait(FIRST_STATUS)
        local_to_run_ns = -self._run_to_local.local(given.time_ns, time.monotonic_ns()) + given.time_ns
        if refusal := self._refusal():
            raise DriverError(refusal)
        with self._lock:
            assert self._status is not None
            stamp_ns = min(self._measured_ns + local_to_run_ns, given.time_ns)
            self._stamp_ns = max(self._stamp_ns, stamp_ns)
            odometry = Odometry(self._stamp_ns, self._pose, self._twist)
            return PlatformOutput(odometry, {}, Contact(bool(self._status.flags & BUMPER)), None)

    def close(self) -> None:
        """Stop the wheels and close the port."""
        with self._lock:
            self._wheels = (0.0, 0.0)
        with suppress(DriverError):  # if the write fails, the base's own watchdog stops it
            self._link.write(speeds(0.0, 0.0))
        self._link.close()

    def _start(self) -> bool:
        """Open the port at the first use, because checking a config must not touch the robot; whether it was opened."""
        if self._link.is_started:
            return False
        self._link.start()
        return True

    def _refusal(self) -> str:
        """Why the base cannot be driven now; empty if it can."""
        with self._lock:
            silent = time.monotonic() - self._heard_at
            if self._status is not None and silent <= self.params.silence:
                pressed = self._status.flags & EMERGENCY_STOP
                return "its emergency stop is pressed: release it" if pressed else ""
        if self._link.fault:
            return self._link.fault
        known = f"for {silent:.2f} s" if math.isfinite(silent) else "yet"
        return f"{self._link.name}: no status with a right checksum {known}: see cable and baud rate"

    # The methods below run in the link's thread.

    def _opened(self) -> None:
        self._frames.clear()

    def _beat(self) -> None:
        is_late = time.monotonic() - self._asked_at > self.params.silence + self.context.period
        wheels = (0.0, 0.0) if is_late or self._refusal() else self._wheels
        self._link.write(speeds(*wheels))

    def _received(self, data: bytes, now_ns: int) -> None:
        for body in self._frames.take(data):
            status = status_of(body)
            if status is not None:
                with self._lock:
                    self._take(status, now_ns)
                self._heard.set()

    def _take(self, status: Status, now_ns: int) -> None:
        """Update the pose by the ticks since the last status; after a restart, the base counts from zero."""
        restarts, before = self._base_clock.restarts, self._status
        self._measured_ns = self._base_clock.local(status.uptime_ms * 1_000_000, now_ns)
        self._status, self._heard_at = status, self._measured_ns * 1e-9  # not now: it may have waited to be read
        if before is None or self._base_clock.restarts > restarts:
            self._twist = Twist2D(0.0, 0.0, 0.0)
            return
        robot = self.context.robot
        a_tick = math.tau * robot.wheel_radius / self.params.ticks_per_turn
        left, right = (a_tick * signed(now - then) for now, then in
                       ((status.left, before.left), (status.right, before.right)))  # fmt: skip
        way, turn = (left + right) / 2.0, (right - left) / (2.0 * robot.half_track)
        heading = self._pose.heading + turn / 2.0
        x, y = self._pose.x + way * math.cos(heading), self._pose.y + way * math.sin(heading)
        self._pose = Pose2D(x, y, math.remainder(self._pose.heading + turn, math.tau))
        seconds = (status.uptime_ms - before.uptime_ms) % TICKS * 1e-3
        if seconds > 0.0:
            self._twist = Twist2D(way / seconds, 0.0, turn / seconds)


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the platform; navloom calls this hook through the entry point."""
    registry.add(SerialBase)
