"""A lidar that sends datagrams, on a cart without motors. docs/writing-a-driver.md explains it.

`Lidar` is the sensor: it can be part of any platform. `LidarCart` is the smallest platform for it: a cart pushed by
hand, for which the localizer `scan_odometry` estimates the pose from the scans alone.
"""

import math
import threading
import time
from collections import deque

import numpy as np
from lidar_packets import CLOCK_NS, Packet, Scans
from navloom import (
    Contact,
    Context,
    Odometry,
    Params,
    Platform,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    RangeScan,
    Registry,
    Twist2D,
    hookimpl,
)
from navloom.drivers.clocks import ClockOffset
from navloom.drivers.link import DriverError, Link
from navloom.drivers.ports import UdpPort
from pydantic import Field

STILL = Twist2D(0.0, 0.0, 0.0)
MOST_SCANS = 16
"""Most scans that wait for the platform's next tick; older ones are dropped."""


class LidarSettings(Params):
    """Settings of a sensor, besides its name and kind."""

    device: str | None = Field(None, description="Address of the lidar; without it, datagrams of any sender are taken.")
    listen: str = Field("127.0.0.1", description="Address of this host that the lidar sends to.")
    port: int = Field(2368, ge=0, le=65535, description="UDP port.")
    x: float = Field(0.0, ge=-10.0, le=10.0, description="Mount in the base frame, m.")
    y: float = Field(0.0, ge=-10.0, le=10.0, description="Mount in the base frame, m.")
    yaw_deg: float = Field(0.0, ge=-360.0, le=360.0, description="Mount in the base frame, degrees.")
    range_min: float = Field(0.05, ge=0.0, le=10.0, description="Shortest measurement, m.")
    range_max: float = Field(30.0, gt=0.0, le=1000.0, description="Longest measurement, m.")
    silence: float = Field(0.5, ge=0.05, le=10.0, description="Time without a scan after which the robot stops, s.")


class Lidar:
    """Reads one lidar in a thread and keeps its scans until the platform reads them."""

    def __init__(self, name: str, settings: LidarSettings) -> None:
        self.settings = settings
        self._packets, self._clock = Scans(), ClockOffset(modulus_ns=CLOCK_NS)
        self._lock = threading.Lock()
        self._scans: deque[tuple[int, list[Packet]]] = deque(maxlen=MOST_SCANS)  # with the time on the local clock
        self._heard_at = -math.inf
        self._link = Link(
            f"lidar {name} at UDP port {settings.port}",
            lambda: UdpPort((settings.listen, settings.port), settings.device),
            self._received,
            silence=math.inf,  # a socket has no cable: opening it again would not help
        )

    def start(self) -> None:
        """Start to listen; later calls do nothing."""
        if not self._link.is_started:
            self._link.start()

    def close(self) -> None:
        """Close the port."""
        self._link.close()

    def refusal(self) -> str:
        """Why the lidar cannot be used now; empty if it can."""
        if self._link.fault:
            return self._link.fault
        silent = time.monotonic() - self._heard_at
        if silent <= self.settings.silence:
            return ""
        return f"{self._link.name}: no scan {f'for {silent:.1f} s' if math.isfinite(silent) else 'yet'}"

    def scans(self, local_to_run_ns: int, now_ns: int) -> list[RangeScan]:
        """Scans completed since the last call, oldest first.

        Args:
            local_to_run_ns: Run clock minus this host's monotonic clock, ns.
            now_ns: Time of the tick on the run clock, ns; later stamps are set to it.
        """
        with self._lock:
            taken, self._scans = list(self._scans), deque(maxlen=MOST_SCANS)
        return [self._scan(min(local_ns + local_to_run_ns, now_ns), parts) for local_ns, parts in taken]

    def _scan(self, stamp_ns: int, parts: list[Packet]) -> RangeScan:
        """A scan in the base frame, without unmeasured or too short readings; too long ones become no echo."""
        given = self.settings
        ranges = np.concatenate([part.ranges for part in parts])
        kept = ranges >= given.range_min
        times = np.concatenate([(p.device_ns - parts[0].device_ns) % CLOCK_NS * 1e-9 + p.times for p in parts])
        bearings = np.concatenate([part.bearings for part in parts]) + math.radians(given.yaw_deg)
        count = int(kept.sum())
        return RangeScan(
            max(0, stamp_ns),
            np.tile((given.x, given.y), (count, 1)),
            np.remainder(bearings[kept] + math.pi, math.tau) - math.pi,
            np.zeros(count),
            times[kept],
            np.where(ranges[kept] >= given.range_max, math.inf, ranges[kept]),
            given.range_min,
            given.range_max,
        )

    def _received(self, data: bytes, now_ns: int) -> None:
        for parts in self._packets.take(data, now_ns):
            # The stamp is the time of the first beam. The datagram was sent after its last beam, so it arrived later.
            local_ns = self._clock.local(parts[0].device_ns, now_ns)
            with self._lock:
                self._scans.append((local_ns, parts))
                self._heard_at = now_ns * 1e-9


class LidarCart(Platform[Params]):
    """A lidar on a cart that is pushed by hand: it has no motors, and its odometry does not move."""

    name = "lidar_cart"
    sensor_kinds = {"udp_lidar": RangeScan}
    sensor_settings = {"udp_lidar": LidarSettings}

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self._lidars = {sensor.name: Lidar(sensor.name, LidarSettings(**sensor.settings)) for sensor in context.sensors}
        self._run_to_local = ClockOffset()

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """The newest scan of each lidar. Raises DriverError while one is silent."""
        for lidar in self._lidars.values():
            lidar.start()
        local_to_run_ns = given.time_ns - self._run_to_local.local(given.time_ns, time.monotonic_ns())
        scans = {}
        for name, lidar in self._lidars.items():
            found = lidar.scans(local_to_run_ns, given.time_ns)
            if refusal := lidar.refusal():
                raise DriverError(refusal)
            if found:
                scans[name] = found[-1]
        return PlatformOutput(Odometry(given.time_ns, Pose2D(0.0, 0.0, 0.0), STILL), scans, Contact(False), None)

    def close(self) -> None:
        """Close the ports."""
        for lidar in self._lidars.values():
            lidar.close()


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the platform; navloom calls this hook through the entry point."""
    registry.add(LidarCart)
