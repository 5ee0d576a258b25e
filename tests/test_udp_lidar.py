"""The lidar of the examples with captures that the test makes: timed datagrams, some lost, doubled or damaged."""

from __future__ import annotations

import math
import random
import re
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom import PlatformInput, RangeScan, Twist2D
from navloom.drivers.link import DriverError
from navloom.roles import SensorSpec
from navloom.testing import context

TOP = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TOP / "examples" / name) for name in ("udp_lidar", "serial_base")]

from lidar_packets import Scans, packets_of  # noqa: E402
from navloom_udp_lidar import LidarCart  # noqa: E402

BEAMS, PARTS, BEAM_NS = 90, 3, 100_000
Capture = list[tuple[float, bytes]]


def ranges_of(number: int) -> np.ndarray:
    """Ranges of a scan, m, to the mm: one beam has no measurement, one no echo."""
    ranges = np.round(2.0 + 0.01 * number + 0.02 * np.arange(BEAMS), 3)
    ranges[3], ranges[5] = math.nan, math.inf
    return ranges


def capture(scans: int, clock_us: int = 0, period: float = 0.02) -> Capture:
    """Time of sending, s, and datagram of each packet of a lidar, whose own clock starts at `clock_us`, µs."""
    found: Capture = []
    for number in range(scans):
        at = number * period
        packets = packets_of(number, clock_us + round(1e6 * at), -45.0, 1.0, BEAM_NS, ranges_of(number), PARTS)
        found += [(at + 1e-9 * BEAM_NS * BEAMS, packet) for packet in packets]
    return found


class Cart:
    """A platform with one lidar, a socket that sends to it, and the scans that it published."""

    def __init__(self, **settings: object) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        spec = SensorSpec("lidar", "udp_lidar", {"port": self.port, **settings})
        self.platform = LidarCart(LidarCart.Params(), context(role="platform", sensors=(spec,)))
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.scans: list[RangeScan] = []
        self.began = time.monotonic()
        self.fault = ""
        self.tick()
        self.until(lambda: "no scan yet" in self.fault)  # it listens

    def tick(self) -> None:
        """Advance the platform, as a live robot does each tick."""
        time_ns = round(1e9 * (time.monotonic() - self.began))
        try:
            given = self.platform.advance(PlatformInput(Twist2D(0.0, 0.0, 0.0), None, time_ns))
            self.scans += [scan for scan in given.scans.values() if isinstance(scan, RangeScan)]
            self.fault = ""
        except DriverError as error:
            self.fault = str(error)

    def until(self, holds: Callable[[], bool], limit: float = 3.0) -> None:
        end = time.monotonic() + limit
        while not holds():
            assert time.monotonic() < end, self.fault
            time.sleep(0.002)
            self.tick()

    def replay(self, sent: Capture) -> None:
        """Send a capture at its own pace, and tick at least every 4 ms meanwhile."""
        began = time.monotonic()
        for at, packet in sent:
            while (left := began + at - time.monotonic()) > 0.0:
                time.sleep(min(left, 0.004))
                self.tick()
            self.socket.sendto(packet, ("127.0.0.1", self.port))

    def close(self) -> None:
        self.platform.close()
        self.socket.close()


@pytest.fixture
def cart() -> Iterator[Cart]:
    made = Cart(range_max=25.0, yaw_deg=90.0, x=0.2)
    yield made
    made.close()


def test_a_capture_becomes_its_scans_with_its_stamps(cart: Cart) -> None:
    cart.replay(capture(15, clock_us=2**32 - 150_000))  # the clock of the lidar wraps meanwhile
    cart.until(lambda: len(cart.scans) >= 14)
    scan = cart.scans[2]
    number = round((scan.ranges[0] - 2.0) / 0.01)
    expected = np.delete(ranges_of(number), 3)
    assert scan.ranges.tolist() == pytest.approx(expected.tolist())
    assert np.degrees(scan.bearings[[0, -1]]).tolist() == pytest.approx([45.0, 134.0])
    assert scan.origins[0].tolist() == [0.2, 0.0] and scan.range_max == 25.0
    # Beams are 0.1 ms apart also where the next datagram begins, at beam 30.
    assert scan.time_offsets[[0, 28, 29, -1]].tolist() == pytest.approx([0.0, 29e-4, 30e-4, 89e-4], abs=2e-6)
    steps = np.diff([range_scan.stamp_ns for range_scan in cart.scans]) * 1e-9
    assert (steps > 0.0).all() and np.median(steps) == pytest.approx(0.02, abs=0.002)


def test_losses_doubles_and_noise_leave_scans_with_fewer_beams(cart: Cart) -> None:
    dice = random.Random(4)
    damaged: Capture = []
    for at, packet in capture(20):
        if dice.random() < 0.15:
            continue
        damaged.append((at, packet))
        damaged += [(at, packet)] * (dice.random() < 0.1)
        damaged += [(at, dice.randbytes(dice.randrange(200)))] * (dice.random() < 0.1)
        damaged += [(at, packet[: dice.randrange(len(packet))])] * (dice.random() < 0.1)
    cart.replay(damaged)
    cart.until(lambda: len(cart.scans) >= 15)
    packets = cart.platform._lidars["lidar"]._packets
    assert packets.lost > 0 and packets.refused > 0
    for scan in cart.scans:
        number = round((float(scan.ranges[0]) - 2.0 - 0.02 * (round(math.degrees(scan.bearings[0])) - 45)) / 0.01)
        places = np.round(np.degrees(scan.bearings)).astype(int) - 45
        assert scan.ranges.tolist() == pytest.approx(ranges_of(number)[places].tolist())


def test_late_datagrams_of_an_older_scan_are_ignored() -> None:
    scans = Scans()
    first, second = (list(packets_of(n, 0, 0.0, 1.0, 1000, ranges_of(n), 3)) for n in (65535, 0))
    order = (first[0], first[2], second[0], first[1], second[1], second[2], second[1])
    found = [part for data in order for part in scans.take(data, 0)]
    assert [[part.number for part in parts] for parts in found] == [[0, 2], [0, 1, 2]]
    assert (scans.lost, scans.refused) == (1, 2)


def test_a_lidar_that_falls_silent_stops_the_robot_with_the_reason(cart: Cart) -> None:
    cart.replay(capture(3))
    cart.until(lambda: cart.fault == "")
    cart.until(lambda: cart.fault != "", 2.0)
    assert cart.fault.startswith(f"lidar lidar at UDP port {cart.port}: no scan for 0.")
    cart.replay(capture(2))
    cart.until(lambda: cart.fault == "")


def test_datagrams_of_another_device_are_ignored_and_a_port_in_use_is_reported(cart: Cart) -> None:
    other = Cart(device="127.0.0.2")
    other.replay(capture(3))
    other.socket.close()
    other.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    other.socket.bind(("127.0.0.2", 0))
    other.replay(capture(1, clock_us=500_000))
    other.until(lambda: other.scans != [])
    assert len(other.scans) == 1
    other.close()
    spec = SensorSpec("lidar", "udp_lidar", {"port": cart.port})
    second = LidarCart(LidarCart.Params(), context(role="platform", sensors=(spec,)))
    with pytest.raises(DriverError, match=r"not opened yet|Address already in use"):
        second.advance(PlatformInput(Twist2D(0.0, 0.0, 0.0), None, 0))
    second.close()


def test_the_two_devices_of_the_docs_are_one_platform(cart: Cart, tmp_path: Path) -> None:
    from play_base import PlayedBase

    page = (TOP / "docs" / "writing-a-driver.md").read_text("utf-8")
    block = re.search(r"<!-- two devices -->\n```py\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert block is not None
    scope: dict[str, Any] = {"__name__": "my_robot"}
    exec(compile(block[1], "my_robot", "exec", dont_inherit=True), scope)
    cls, base = scope["BaseWithLidar"], PlayedBase(tmp_path / "base")
    cart.platform.close()
    cart.platform = cls(cls.Params(port=str(base.port)), cart.platform.context)
    cart.replay(capture(8))
    cart.until(lambda: len(cart.scans) >= 2 and cart.fault == "")
    base.unplug()
    cart.until(lambda: cart.fault.startswith("base at "))
    base.close()
