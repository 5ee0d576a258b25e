"""The live platform: commands to its wheels, also where sending them fails."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from cell_rig import silent_bus
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.nodes.platform_node import PlatformNode
from navloom.messages import Command, Contact, Envelope, Odometry, Pose2D, RangeScan, Twist2D
from navloom.roles import PlatformOutput, SensorSpec
from navloom_live.live import live_platform, live_runner, publisher_restarts
from navloom_live.live.live_node_builder import Hosted, make_cell
from navloom_live.live.live_platform import LivePlatform
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.run_clock import RunClock
from navloom_live.transport.keyspace import KeySpace

PERIOD, DEADLINE = 0.05, 0.1
SYSTEM = assemble(load_config("paper"))
SOURCE = ("platform", SYSTEM.config.platform.instance)
KEYS = KeySpace("lab", "r1")
AHEAD, STILL = Twist2D(0.3, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)


class Base:
    """A base whose line to the wheels can break; `told` has the commands that arrived."""

    role = "platform"
    sensor_kinds = {"ring": RangeScan}

    def __init__(self) -> None:
        self.scans: dict[str, Any] = {}
        self.told: list[Twist2D] = []
        self.broken = 0
        self.told_at_close: list[Twist2D] | None = None

    def close(self) -> None:
        self.told_at_close = list(self.told)

    def drive(self, command: Twist2D, time_ns: int) -> None:
        if self.broken:
            self.broken -= 1
            raise OSError(5, "Input/output error")
        self.told.append(command)

    def advance(self, given: Any) -> PlatformOutput:
        pose = Pose2D(0.0, 0.0, 0.0)
        return PlatformOutput(Odometry(given.time_ns, pose, STILL), self.scans, Contact(False), None)


class Robot:
    """The runner of a platform on a clock that the test sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        self.base = Base()
        self.ended = False
        clock = SimpleNamespace(
            monotonic=lambda: self.now, monotonic_ns=lambda: round(self.now * 1e9), sleep=lambda s: None
        )
        for module in (live_runner, live_platform):
            monkeypatch.setattr(module, "time", clock)
        node = PlatformNode(self.base, [SensorSpec("sonars", "ring")])  # type: ignore[arg-type]
        self.hosted: Hosted = make_cell(SYSTEM, SOURCE, node, Switchboard(silent_bus(), KEYS, lossless=False))
        self.runner = LivePlatform(
            self.hosted, RunClock(clock.monotonic_ns), PERIOD, lambda: self.ended, DEADLINE, clock.monotonic_ns()
        )
        self.runner._next = 0  # as `run` does

    def command(self, twist: Twist2D, sequence: int, age: float = 0.0) -> None:
        """The gate says something that derives from a stamp of some s ago."""
        key = KEYS.port("gate", "main", "command")
        (inlet,) = [feed.inlet for feed in self.hosted.cell.feeds if feed.inlet.key == key]
        stamp = round((self.now - 1000.0 - age) * 1e9)
        inlet.give((Command(twist), Envelope(key, sequence, sequence, stamp, stamp, 0)))

    def turn(self, seconds: float) -> None:
        """Let it run for a while, with a turn every 10 ms."""
        for _ in range(round(seconds / 0.01)):
            self.runner.take_in()
            self.runner.act()
            self.now += 0.01


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Robot:
    return Robot(monkeypatch)


def test_without_the_gate_the_wheels_stop_after_the_deadline(robot: Robot) -> None:
    robot.command(AHEAD, 1)
    robot.turn(DEADLINE)
    assert robot.base.told == [AHEAD]
    robot.turn(0.03)
    assert robot.base.told == [AHEAD, STILL] and robot.runner.stops == 1


@pytest.mark.parametrize(("age", "own"), [(0.0, 6), (0.03, 0)], ids=["its own", "of the tick before"])
def test_ticks_that_are_driven_by_their_own_command_are_counted(robot: Robot, age: float, own: int) -> None:
    for number in range(1, 8):
        robot.turn(0.02)  # of the tick; the next begins after 30 ms more
        robot.command(AHEAD, number, age)
        robot.turn(0.03)
    assert (robot.runner.driven, robot.runner.own) == (6, own)


def test_a_skipped_tick_is_driven_by_an_old_command(robot: Robot) -> None:
    robot.turn(0.02)
    robot.command(AHEAD, 1)
    robot.turn(0.01)
    robot.now += 0.05
    robot.turn(0.01)
    assert (robot.runner.driven, robot.runner.own) == (1, 1)
    robot.command(AHEAD, 2)
    robot.turn(0.01)
    robot.now += 0.07  # until 0.17 s: the tick at 0.1 s was skipped
    robot.turn(0.01)
    assert (robot.runner.driven, robot.runner.own) == (3, 2)


def test_a_stop_that_does_not_get_through_is_repeated_until_it_does(robot: Robot) -> None:
    robot.command(AHEAD, 1)
    robot.turn(0.05)
    robot.base.broken = 4
    robot.command(STILL, 2)
    robot.turn(0.03)
    assert robot.base.told == [AHEAD] and robot.base.broken == 1
    assert "Input/output error" in robot.runner.fault
    robot.turn(0.02)
    assert robot.base.told == [AHEAD, STILL]
    robot.turn(0.1)
    assert robot.runner.fault == "" and robot.base.told == [AHEAD, STILL]


def test_the_platforms_own_stop_is_repeated_as_well(robot: Robot) -> None:
    robot.command(AHEAD, 1)
    robot.turn(0.05)
    robot.base.broken = 9
    robot.turn(0.2)
    assert robot.base.told == [AHEAD, STILL] and robot.runner.stops == 1


def test_a_scan_of_a_sensor_that_is_not_there_is_the_plugins_fault(robot: Robot) -> None:
    robot.base.scans = {"sonar": None}
    robot.turn(0.1)
    assert "advance() gave a scan of 'sonar', expected one of sonars" in robot.runner.fault


def test_wheels_that_stay_unreachable_end_the_process(robot: Robot) -> None:
    robot.command(AHEAD, 1)
    robot.turn(0.05)
    robot.base.broken = 10_000
    with pytest.raises(RuntimeError, match=r"commands to the wheels failed for 1 s: .*Input/output error"):
        robot.turn(3.0)
    assert 1001.1 < robot.now < 1001.3


def test_the_wheels_get_a_stop_whatever_ends_the_thread(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.command(AHEAD, 1)
    robot.turn(0.05)

    def breaks(*given: object) -> None:
        raise KeyError("unknown port")

    monkeypatch.setattr(robot.hosted.cell, "tell", breaks)
    with pytest.raises(KeyError):
        robot.runner.run()
    assert robot.base.told[-1] == STILL


def test_a_platform_closes_its_ports_after_the_last_stop(robot: Robot) -> None:
    robot.ended = True
    robot.runner.run()
    assert robot.base.told_at_close == [STILL]


def test_commands_of_two_gates_stop_the_wheels_until_only_one_is_left(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publisher_restarts, "time", live_runner.time)
    robot.runner._processes = lambda source: "on host base (process 12) and on host copy (process 14)"
    for number in range(1, 5):
        for begin in (500, 0):
            robot.command(AHEAD, begin + number)
            robot.turn(0.02)
    assert robot.base.told[-1] == STILL
    assert robot.runner.fault.startswith(
        "two gates send commands: gate main runs on host base (process 12) and on host"
    )
    for number in range(5, 60):
        robot.command(AHEAD, 500 + number)
        robot.turn(0.05)
    assert robot.base.told[-1] == AHEAD and robot.runner.fault == ""


# --- when it wakes, and what it counts --------------------------------------------------------------------------------


def test_it_wakes_for_the_next_tick(robot: Robot) -> None:
    robot.turn(0.03)
    assert robot.runner.wait_time() == pytest.approx(0.02)
    robot.now += 0.035
    assert robot.runner.wait_time() == 0.0
    robot.runner._next = 60
    assert robot.runner.wait_time() == 0.5, "not longer, so that it sees that the process ends"


@pytest.mark.parametrize(("age", "wait"), [(0.0, 0.05), (0.075, 0.0252), (0.0995, 0.0007)])
def test_it_wakes_when_the_command_goes_stale(robot: Robot, age: float, wait: float) -> None:
    """A tenth of a second after the stamp that it derives from, and 0.2 ms more; or for the next tick, in 50 ms."""
    robot.turn(0.01)
    robot.now += 0.04
    robot.turn(0.01)
    robot.now -= 0.01
    robot.command(AHEAD, 1, age)
    robot.runner.take_in()
    robot.runner.act()
    assert robot.base.told == [AHEAD]
    assert robot.runner.wait_time() == pytest.approx(wait, abs=1e-7)


def test_a_robot_that_stands_has_no_command_that_goes_stale(robot: Robot) -> None:
    robot.turn(0.01)
    robot.command(STILL, 1, 0.0999)
    robot.runner.take_in()
    robot.runner.act()
    assert robot.base.told == [STILL] and robot.runner.wait_time() == pytest.approx(0.04)


def test_it_tries_again_every_10_ms_while_the_wheels_refuse(robot: Robot) -> None:
    robot.turn(0.01)
    robot.base.broken = 1
    robot.command(AHEAD, 1)
    robot.runner.take_in()
    robot.runner.act()
    assert robot.runner.wait_time() == pytest.approx(0.01)
    robot.now += 0.035
    assert robot.runner.wait_time() == pytest.approx(0.005), "the tick comes before that"


@pytest.mark.parametrize(
    ("age", "passes"),
    [(0.0, True), (0.1, True), (0.100001, False), (-0.000001, False)],
    ids=["0", "100", "over", "ahead"],
)
def test_a_command_passes_if_it_derives_from_the_last_tenth_of_a_second(robot: Robot, age: float, passes: bool) -> None:
    robot.now += 0.21
    robot.command(AHEAD, 1, age)
    robot.runner.take_in()
    robot.runner.act()
    assert robot.base.told == ([AHEAD] if passes else [])


def test_each_command_is_sent_once(robot: Robot) -> None:
    robot.turn(0.01)
    slow = Twist2D(0.1, 0.0, 0.2)
    for sequence, twist in ((1, AHEAD), (2, slow), (3, slow)):
        robot.command(twist, sequence)
        robot.turn(0.02)
    assert robot.base.told == [AHEAD, slow, slow]


def test_a_stale_stop_is_not_repeated_and_a_new_command_drives_again(robot: Robot) -> None:
    robot.command(AHEAD, 1)
    robot.turn(0.5)
    assert robot.base.told == [AHEAD, STILL] and robot.runner.stops == 1
    robot.command(AHEAD, 2)
    robot.turn(0.09)
    assert robot.base.told == [AHEAD, STILL, AHEAD] and robot.runner.stops == 1
    robot.turn(0.1)
    assert robot.runner.stops == 2


@pytest.mark.parametrize("twist", [AHEAD, Twist2D(0.0, 0.0, 0.4)], ids=["drive", "turn"])
def test_a_command_is_stale_beyond_the_deadline_and_not_at_it(robot: Robot, twist: Twist2D) -> None:
    robot.command(twist, 1)
    for now, told in ((1000.0, [twist]), (1000.1, [twist]), (1000.100001, [twist, STILL])):
        robot.now = now
        robot.runner.take_in()
        robot.runner.act()
        assert robot.base.told == told


def test_ticks_and_late_ones_are_counted(robot: Robot) -> None:
    """Ticks at 0 and 50 ms; at 100 ms one that is 30 ms late; one at 150 ms is skipped, and its next on time."""
    robot.turn(0.06)
    assert (robot.runner.ticks, robot.runner.late) == (2, 0)
    robot.now += 0.07
    robot.turn(0.01)
    assert (robot.runner.ticks, robot.runner.late) == (3, 1)
    robot.now = 1000.205
    robot.turn(0.01)
    assert (robot.runner.ticks, robot.runner.late) == (4, 2)
    robot.now = 1000.275
    robot.turn(0.01)
    assert (robot.runner.ticks, robot.runner.late) == (5, 2), "half a period is not late"
    robot.now = 1000.401
    robot.turn(0.01)
    assert (robot.runner.ticks, robot.runner.late) == (6, 4), "two were skipped"


@pytest.mark.parametrize(("age", "own"), [(0.019, 1), (0.02, 1), (0.021, 0)])
def test_only_ticks_in_which_the_wheels_turn_are_driven(robot: Robot, age: float, own: int) -> None:
    """The command of the tick at 100 ms derives from its stamp or later."""
    robot.turn(0.12)
    assert (robot.runner.ticks, robot.runner.driven, robot.runner.own) == (3, 0, 0)
    robot.command(AHEAD, 1, age)
    robot.turn(0.06)
    assert (robot.runner.ticks, robot.runner.driven, robot.runner.own) == (4, 1, own)


class Listening(Base):
    """A base that keeps what it is given, and the time of each command."""

    def __init__(self) -> None:
        super().__init__()
        self.given: list[Any] = []
        self.times: list[int] = []

    def drive(self, command: Twist2D, time_ns: int) -> None:
        super().drive(command, time_ns)
        self.times.append(time_ns)

    def advance(self, given: Any) -> PlatformOutput:
        self.given.append(given)
        return super().advance(given)


def listening(robot: Robot) -> Listening:
    base = Listening()
    robot.runner.platform = robot.runner.node.plugin = robot.base = base  # type: ignore[assignment]
    return base


def test_a_tick_has_its_own_time_and_the_command_that_the_wheels_have(robot: Robot) -> None:
    base = listening(robot)
    robot.turn(0.02)
    robot.command(AHEAD, 1)
    robot.turn(0.04)
    assert [(given.time_ns, given.command) for given in base.given] == [(0, STILL), (50_000_000, AHEAD)]
    assert base.times == [20_000_000]
    found = robot.hosted.cell.outlets["odometry"].last
    assert found is not None
    assert (found[1].tick, found[1].stamp_ns, found[1].cause_ns) == (1, 50_000_000, 50_000_000)
    assert (robot.runner.clock.tick, robot.runner.clock.stamp_ns) == (1, 50_000_000)


def test_a_tick_has_its_time_in_seconds_too(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    node, times = robot.runner.node, list[float]()
    step = node.step
    monkeypatch.setattr(node, "step", lambda tick: (times.append(tick.time), step(tick))[1])
    robot.turn(0.02)
    robot.turn(0.04)
    assert times == pytest.approx([0.0, 0.05])


def test_before_run_clock_0_commands_have_its_time(robot: Robot) -> None:
    base = listening(robot)
    robot.now -= 3.0
    robot.runner._drive(STILL)
    assert base.times == [0]


@pytest.mark.parametrize(("late", "first"), [(0.0, 0), (0.01, 1), (0.05, 1), (0.07, 2), (-3.0, 0)])
def test_it_begins_with_the_next_whole_tick_once_it_may(robot: Robot, late: float, first: int) -> None:
    waits = iter([False, False, True])
    slept: list[float] = []
    live_platform.time.sleep = slept.append  # type: ignore[assignment]
    robot.runner._may_begin = lambda: next(waits)
    robot.now += late
    asked = iter([False, False, True])
    robot.runner.ends = lambda: next(asked)
    robot.runner.run()
    assert robot.runner._next == first and slept == [0.01, 0.01]


def test_the_odometry_is_sent_last(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    monkeypatch.setattr(robot.hosted.cell, "tell", lambda outputs, *given: order.extend(out.name for out, _ in outputs))
    robot.turn(0.01)
    assert len(order) > 1 and order[-1] == "odometry" and order.count("odometry") == 1


def test_only_the_gates_command_wakes_it(robot: Robot) -> None:
    assert {feed.wire.input.name for feed in robot.hosted.cell.feeds if feed.inlet.rings} == {"command"}


def test_a_refusal_is_told_with_one_tick(robot: Robot) -> None:
    robot.turn(0.01)
    robot.base.broken = 1
    robot.command(AHEAD, 1)
    robot.turn(0.05)
    assert "Input/output error" in robot.runner.fault and robot.runner.faulted == 1
    robot.turn(0.05)
    assert robot.runner.fault == "" and robot.runner.faulted == 0


def test_the_fault_of_a_step_comes_before_a_refusal(robot: Robot) -> None:
    robot.turn(0.01)
    robot.base.scans = {"sonar": None}
    robot.base.broken = 1
    robot.command(AHEAD, 1)
    robot.turn(0.05)
    assert "gave a scan of 'sonar'" in robot.runner.fault and robot.runner.faulted == 1
    robot.base.broken = 1
    robot.command(STILL, 2)
    robot.turn(0.05)
    assert "gave a scan of 'sonar'" in robot.runner.fault and robot.runner.faulted == 2


def test_wheels_may_be_unreachable_for_a_second_again_after_they_were_reached(robot: Robot) -> None:
    robot.turn(0.01)
    robot.base.broken = 60  # every 10 ms
    robot.command(AHEAD, 1)
    robot.turn(0.7)
    assert robot.base.broken == 0
    robot.base.broken = 60
    robot.command(STILL, 2)
    robot.turn(0.7)
    assert robot.base.told[-1] == STILL
