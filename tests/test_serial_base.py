"""The serial base of the examples, driving a base that is simulated, with physics, on a pseudo-terminal."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from navloom import PlatformInput, Twist2D
from navloom.drivers.link import DriverError
from navloom.testing import context, robot

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "serial_base"
sys.path.insert(0, str(FOLDER))

from navloom_serial_base import SerialBase  # noqa: E402
from play_base import PlayedBase  # noqa: E402
from serial_protocol import BUMPER, EMERGENCY_STOP, WATCHDOG, Frames, Status, framed, speeds, status  # noqa: E402

PERIOD = 0.05
STOPPED = 0.150
"""Longest time from a fault to a stop command at the base, where its line still works, s."""
SETTLED = 0.03
"""Margin for the simulated base to notice that its watchdog has expired, on a busy host, s."""
SPEC = robot(wheel_radius=0.05, half_track=0.15)


class Loop:
    """Calls a platform as a live robot does: each tick a command and a report, and a stop where a report fails.

    Attributes:
        wanted: Command of the gate.
        fault: Why the last report failed; empty if it did not.
        output: The last report.
        slowest: Longest duration of a tick, s.
    """

    def __init__(self, platform: SerialBase) -> None:
        self.platform, self.wanted = platform, Twist2D(0.0, 0.0, 0.0)
        self.fault, self.output = "not begun", Any
        self.slowest = 0.0
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        began, number = time.monotonic(), 0
        while not self._ends.wait(max(0.0, began + number * PERIOD - time.monotonic())):
            at_ns = round(number * PERIOD * 1e9)
            before = time.monotonic()
            try:
                self.output = self.platform.advance(PlatformInput(self.wanted, None, at_ns))
                self.fault = ""
            except DriverError as error:
                self.fault = str(error)
            with suppress(DriverError):  # a live robot tries again until its platform takes it
                self.platform.drive(Twist2D(0.0, 0.0, 0.0) if self.fault else self.wanted, at_ns)
            self.slowest = max(self.slowest, time.monotonic() - before) if number else 0.0
            number += 1

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self.platform.close()


@pytest.fixture
def base(tmp_path: Path) -> Iterator[PlayedBase]:
    played = PlayedBase(tmp_path / "base")
    yield played
    played.close()


@pytest.fixture
def loop(base: PlayedBase) -> Iterator[Loop]:
    made = Loop(SerialBase(SerialBase.Params(port=str(base.port)), context(SPEC, role="platform", period=PERIOD)))
    yield made
    made.close()


def until(holds: Callable[[], bool], limit: float, what: str) -> float:
    """Wait until a condition holds; returns the time it took, s."""
    began = time.monotonic()
    while not holds():
        assert time.monotonic() - began < limit, f"{what} within {limit} s"
        time.sleep(0.002)
    return time.monotonic() - began


def drives(base: PlayedBase, loop: Loop, speed: float = 0.3) -> None:
    """Drive forward and wait until the wheels turn at 90 % of the speed."""
    loop.wanted = Twist2D(speed, 0.0, 0.0)
    until(lambda: min(base.wheels) > 0.9 * speed, 3.0, f"the base drives; {loop.fault}")


def test_it_obeys_commands_and_its_odometry_follows_the_wheels(base: PlayedBase, loop: Loop) -> None:
    drives(base, loop)
    loop.wanted = Twist2D(0.3, 0.0, 1.0)
    until(lambda: loop.output.odometry.pose.heading > 0.5, 3.0, "it turns")
    # v ± ω · half of the track: 0.3 ± 0.15 m/s.
    assert base.wanted == (pytest.approx(0.15), pytest.approx(0.45))
    loop.wanted = Twist2D(0.0, 0.0, 0.0)
    until(lambda: base.wheels == (0.0, 0.0), 1.0, "it stands")
    until(lambda: loop.output.odometry.twist.vx == 0.0, 1.0, "it says so")
    left, right = base._way
    assert loop.output.odometry.pose.heading == pytest.approx((right - left) / 0.3, abs=0.01)
    assert math.hypot(loop.output.odometry.pose.x, loop.output.odometry.pose.y) <= (left + right) / 2.0 + 0.01


def test_its_stamps_never_fall_and_advance_with_time(base: PlayedBase, loop: Loop) -> None:
    until(lambda: loop.fault == "", 3.0, "it begins")
    stamps, began = [loop.output.odometry.stamp_ns], time.monotonic()
    for _ in range(8):
        until(lambda: loop.output.odometry.stamp_ns != stamps[-1], 1.0, "another stamp")
        stamps.append(loop.output.odometry.stamp_ns)
    assert stamps == sorted(stamps)
    assert stamps[-1] - stamps[0] > 0.5e9 * (time.monotonic() - began)


def test_emergency_stop_and_bumper_are_reported(base: PlayedBase, loop: Loop) -> None:
    drives(base, loop)
    base.flags = BUMPER
    until(lambda: loop.output.contact.touching, 1.0, "the bumper is told")
    base.flags = EMERGENCY_STOP
    until(lambda: loop.fault == "its emergency stop is pressed: release it", 1.0, "the button is told")
    base.flags = 0
    until(lambda: loop.fault == "" and min(base.wheels) > 0.2, 2.0, "it drives on")


def test_a_base_that_was_switched_off_does_not_move_the_pose(base: PlayedBase, loop: Loop) -> None:
    drives(base, loop)
    loop.wanted = Twist2D(0.0, 0.0, 0.0)
    until(lambda: base.wheels == (0.0, 0.0), 1.0, "it stands")
    until(lambda: loop.output.odometry.twist.vx == 0.0, 1.0, "it says so")
    before = loop.output.odometry.pose.x
    base.reboot()
    stamp_ns = loop.output.odometry.stamp_ns
    until(lambda: loop.output.odometry.stamp_ns > stamp_ns + 2e8, 2.0, "it goes on")
    assert loop.output.odometry.pose.x == before


def test_the_base_stops_when_its_platform_is_no_longer_called(base: PlayedBase) -> None:
    platform = SerialBase(SerialBase.Params(port=str(base.port)), context(SPEC, role="platform", period=PERIOD))
    platform.advance(PlatformInput(Twist2D(0.0, 0.0, 0.0), None, 0))
    platform.drive(Twist2D(0.3, 0.0, 0.0), 0)
    until(lambda: base.wanted[0] > 0.0, 1.0, "it drives")
    until(lambda: base.wanted == (0.0, 0.0), 0.2, "it is told to stop")
    platform.close()

    def refusal() -> str:
        try:
            platform.advance(PlatformInput(Twist2D(0.0, 0.0, 0.0), None, 10**9))
        except DriverError as error:
            return str(error)
        return ""

    until(lambda: "closed" in refusal(), 1.0, "it is refused")


def test_a_status_that_waited_to_be_read_does_not_count_as_new(tmp_path: Path) -> None:
    platform = SerialBase(SerialBase.Params(port=str(tmp_path / "none")), context(SPEC, role="platform", period=PERIOD))
    now_ns = time.monotonic_ns()
    platform._received(status(Status(0, 0, 0, 0, 24_000)), now_ns - 10**9)
    platform._received(status(Status(20, 0, 0, 0, 24_000)), now_ns)  # measured 0.98 s ago
    with pytest.raises(DriverError):
        platform.advance(PlatformInput(Twist2D(0.0, 0.0, 0.0), None, 0))
    platform.close()


FAULTS = ("unplugged", "garbage", "mute", "stuck", "half")
CUT = ("unplugged", "stuck")
"""Faults in which no command reaches the base, so that only its own watchdog stops it."""


def endure(base: PlayedBase, loop: Loop, fault: str) -> tuple[float, float]:
    """Cause a fault while it drives. Returns s from the fault to the stop, and from its end to driving again."""
    drives(base, loop)
    began = time.monotonic()
    if fault == "unplugged":
        base.unplug()
    else:
        base.fault = fault
    until(lambda: base.stopped_at < math.inf, 1.0, f"{fault}: it stops")
    stopped = base.stopped_at - began
    until(lambda: loop.fault != "", 1.0, f"{fault}: it is said")
    first = base.stopped_at
    time.sleep(0.3)  # the fault lasts
    assert base.stopped_at == first, f"{fault}: it drives on"
    if fault == "unplugged":
        base.plug()
    base.fault = ""
    return stopped, until(lambda: loop.fault == "" and base.wanted[0] > 0.2, 4.0, f"{fault}: it drives again")


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_stops_it_in_time_and_it_drives_again(base: PlayedBase, loop: Loop, fault: str) -> None:
    stopped, _ = endure(base, loop, fault)
    assert stopped < (WATCHDOG + 0.02 + SETTLED if fault in CUT else STOPPED)
    assert loop.slowest < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_twenty_of_each_fault(base: PlayedBase, loop: Loop, fault: str) -> None:
    times = [endure(base, loop, fault) for _ in range(20)]
    stops, returns = zip(*times, strict=True)
    print(f"{fault}: stopped after {1e3 * min(stops):.0f} to {1e3 * max(stops):.0f} ms, drove again after at most "
          f"{max(returns):.2f} s; slowest call {1e3 * loop.slowest:.0f} ms")  # fmt: skip
    assert max(stops) < (WATCHDOG + 0.02 + SETTLED if fault in CUT else STOPPED)
    assert loop.slowest < 0.1


def test_frames_are_found_among_noise_and_none_is_made_up() -> None:
    good = status(Status(7, -3, 2**31 + 5, 1, 24_000)) + speeds(0.5, -0.5)
    frames, noise = Frames(), b"\xaa\x55\x0c\xaa\xaa\x55\xff noise"
    whole = frames.take(noise + good + noise + good)
    assert len(whole) == 4 and whole[:2] == whole[2:]
    broken = bytearray(framed(b"\x81 a body"))
    for place in range(len(broken)):
        for bit in range(8):
            damaged = bytearray(broken)
            damaged[place] ^= 1 << bit
            assert Frames().take(bytes(damaged)) == []
    one_by_one = Frames()
    assert [body for byte in noise + good for body in one_by_one.take(bytes([byte]))] == whole[:2]


@pytest.mark.parametrize(("words", "said"), [((), "expected PORT"), (("letter",), "letter: no port can be made there")])
def test_a_played_base_is_given_its_port_and_removes_no_file(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    (tmp_path / "letter").write_text("mine", "utf-8")
    command = [sys.executable, str(FOLDER / "play_base.py"), *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and done.stderr.startswith(said) and len(done.stderr.splitlines()) == 1
    assert (tmp_path / "letter").read_text("utf-8") == "mine"
