"""When a live node steps: which inputs trigger it, and which it waits for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cell_rig import silent_bus
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import goal_rules
from navloom.engine.nodes.avoider_node import AvoiderNode
from navloom.engine.nodes.goal_node import GoalNode
from navloom.engine.nodes.mapper_node import MapperNode
from navloom.engine.nodes.node_base import Tick
from navloom.messages import (
    ClearRequest,
    Envelope,
    Goal,
    OperatorRequest,
    Pose2D,
    PoseEstimate,
    StepReport,
    Sweep,
    TrackingCommand,
    Twist2D,
)
from navloom.navigation.goal_machine import GoalMachine
from navloom_live.live import live_goal, live_runner
from navloom_live.live.live_goal import LiveGoal
from navloom_live.live.live_node_builder import Hosted, all_sources, make_cell
from navloom_live.live.live_runner import LiveRunner
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.run_clock import RunClock
from navloom_live.transport.keyspace import KeySpace

PERIOD = 0.05
KEYS = KeySpace("lab", "r1")
SYSTEM = assemble(load_config("paper"))
NAMES = dict(reversed(all_sources(SYSTEM)))
"""The active instance of each role."""
STILL = Twist2D(0.0, 0.0, 0.0)
ORIGIN = Pose2D(0.0, 0.0, 0.0)
SWEEP = Sweep(
    0, 1, np.ones((1, 1)), np.zeros(1), np.zeros(1), np.zeros(1), "paper", 0.0, 0.0, 0.4, 0.02, 4.0
)  # fmt: skip
REPORT = StepReport("tick", (), (), True, 0, 0, 0, "", "")


class Clock:
    """The monotonic clock of the host, set by the test; replaces the module `time`."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now

    def monotonic_ns(self) -> int:
        return round(self.now * 1e9)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(live_runner, "time", made)
    monkeypatch.setattr(live_goal, "time", made)
    return made


def hosted(role: str, node: Any) -> Hosted:
    return make_cell(SYSTEM, (role, NAMES[role]), node, Switchboard(silent_bus(), KEYS, lossless=False))


def give(at: Hosted, source: str, port: str, message: Any, tick: int) -> None:
    key = KEYS.port(source, NAMES[source], port)
    inlets = [feed.inlet for feed in at.cell.feeds] + list(at.cell.reports.values())
    heard = [inlet for inlet in inlets if inlet.key == key]
    assert len(heard) == 1 or port == "step"  # a report that adds nothing to its message has no reader
    for inlet in heard:
        inlet.give((message, Envelope(key, tick, tick, round(tick * PERIOD * 1e9), round(tick * PERIOD * 1e9), 0)))


def give_pose(at: Hosted, tick: int) -> None:
    """Receive the localizer's pose of a tick, and optionally its report."""
    give(at, "localizer", "pose", PoseEstimate(round(tick * PERIOD * 1e9), ORIGIN, STILL, np.zeros((3, 3))), tick)
    give(at, "localizer", "step", REPORT, tick)


class Listener(MapperNode):
    """A mapper node that records how many poses each step received."""

    def __init__(self) -> None:
        self.poses: list[int] = []

    def step(self, tick: Tick) -> None:
        self.poses.append(len(self.track.values))


def turn(runner: LiveRunner) -> None:
    runner.take_in()
    runner.act()


def test_a_mapper_waits_for_the_poses_that_cover_a_sweep(clock: Clock) -> None:
    node = Listener()
    mapper = hosted("mapper", node)
    runner = LiveRunner(mapper, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    for tick in (1, 2):
        give_pose(mapper, tick)
    give(mapper, "platform", "laser", SWEEP, 4)
    give(mapper, "platform", "step", REPORT, 4)
    for wait in (0.0, 0.1, 0.4):
        clock.now += wait
        turn(runner)
    assert node.poses == []
    for tick in (3, 4):
        give_pose(mapper, tick)
    turn(runner)
    assert node.poses == [4]


def test_a_mapper_that_waits_in_vain_for_poses_steps_without_them(clock: Clock) -> None:
    node = Listener()
    mapper = hosted("mapper", node)
    runner = LiveRunner(mapper, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    give(mapper, "platform", "laser", SWEEP, 4)
    turn(runner)
    assert node.poses == []
    clock.now += 1.1
    turn(runner)
    assert node.poses == [0]


def test_a_mapper_of_scans_steps_though_the_poses_are_some_ticks_behind(clock: Clock) -> None:
    node = Listener()
    mapper = hosted("mapper", node)
    runner = LiveRunner(mapper, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    for tick in range(40):
        give(mapper, "platform", "laser", SWEEP, tick)
        give(mapper, "platform", "step", REPORT, tick)
        if tick >= 2:
            give_pose(mapper, tick - 2)
        turn(runner)
        clock.now += PERIOD
    assert len(node.poses) > 10  # every third tick, and not once a second


def test_a_mapper_whose_localizer_is_gone_steps_though_scans_go_on(clock: Clock) -> None:
    node = Listener()
    mapper = hosted("mapper", node)
    runner = LiveRunner(mapper, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    for tick in range(60):
        give(mapper, "platform", "laser", SWEEP, tick)
        give(mapper, "platform", "step", REPORT, tick)
        turn(runner)
        clock.now += PERIOD
    assert len(node.poses) == 2  # one each second


class Steps(AvoiderNode):
    """An avoider node that records the ticks of its steps."""

    def __init__(self) -> None:
        self.ticks: list[int] = []

    def step(self, tick: Tick) -> None:
        self.ticks.append(tick.number)


def test_an_avoider_that_joins_a_drive_waits_for_the_first_pose_and_reference(clock: Clock) -> None:
    node = Steps()
    avoider = hosted("avoider", node)
    runner = LiveRunner(avoider, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    command = TrackingCommand(STILL, 0.0, 0.0, 0.0)
    give(avoider, "controller", "command", command, 7)
    for wait in (0.0, 0.01, 0.1):  # beyond the wait between two steps, 5 ms
        clock.now += wait
        turn(runner)
    assert node.ticks == []
    for _ in range(2):
        clock.now += 0.2
        turn(runner)
    assert node.ticks == [7]  # but not for ever


def test_after_a_restart_of_the_run_clock_a_node_steps_by_the_new_one(clock: Clock) -> None:
    node = Listener()
    mapper = hosted("mapper", node)
    runner = LiveRunner(mapper, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    for tick in (72_000, 72_001, 5, 6, 7):
        give_pose(mapper, tick)
        give(mapper, "platform", "laser", SWEEP, tick)
        give(mapper, "platform", "step", REPORT, tick)
        turn(runner)
    assert node.poses == [1, 2, 1, 2, 3]  # poses of the old clock do not cover a sweep of the new one


def test_an_old_message_does_not_put_the_clock_back(clock: Clock) -> None:
    """A replayed command, half a minute old, counts as late and triggers no step."""
    node = Listener()
    mapper = hosted("mapper", node)
    run_clock = RunClock(clock.monotonic_ns)
    runner = LiveRunner(mapper, run_clock, PERIOD, lambda: False)
    for tick in (1000, 1001, 400, 401, 1002):
        if tick >= 1000:
            run_clock.observe(round(tick * PERIOD * 1e9), clock.monotonic_ns(), tick)
            give_pose(mapper, tick)
        give(mapper, "platform", "laser", SWEEP, tick)
        give(mapper, "platform", "step", REPORT, 1002)
        turn(runner)
    assert node.poses == [1, 2, 3] and mapper.cell.stepper.stepped == 1002


def test_messages_of_the_old_clock_do_not_trigger_steps_by_the_new_one(clock: Clock) -> None:
    node = Listener()
    mapper = hosted("mapper", node)
    runner = LiveRunner(mapper, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    give(mapper, "goal", "clear", ClearRequest(1), 72_000)
    for tick in (72_000, 5):
        give(mapper, "platform", "laser", SWEEP, tick)
        give(mapper, "platform", "step", REPORT, tick)
        give_pose(mapper, tick)
        turn(runner)
    assert mapper.cell.stepper.stepped == 5
    assert max(feed.slot.tick for feed in mapper.cell.feeds) == 5


def test_an_overtaken_message_is_skipped(clock: Clock) -> None:
    node = Listener()
    mapper = hosted("mapper", node)
    runner = LiveRunner(mapper, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    for tick in (300, 299, 101):
        give_pose(mapper, tick)
        give(mapper, "platform", "laser", SWEEP, tick)
        give(mapper, "platform", "step", REPORT, tick)
        turn(runner)
    assert mapper.cell.stepper.stepped == 300 and len(node.poses) == 1


def test_an_active_instance_steps_after_its_process_restarted_without_a_wake_up() -> None:
    node = Listener()
    mapper = hosted("mapper", node)
    mapper.cell.stepper.enabled = mapper.cell.stepper.active = False  # as a waiting alternative begins
    runner = LiveRunner(mapper, RunClock(), PERIOD, lambda: False)
    runner.recall({"mapper": "other"}, 1)
    assert not mapper.cell.stepper.enabled
    runner.recall({"mapper": NAMES["mapper"]}, 2)
    assert mapper.cell.stepper.enabled and mapper.cell.stepper.active


def test_a_goal_that_steps_for_a_request_does_not_run_ahead_of_the_platform(clock: Clock) -> None:
    """It steps by itself only in a tick that the platform has had, so that it is in time for the next pose."""
    goal = hosted("goal", GoalNode(GoalMachine(goal_rules(SYSTEM))))
    run_clock = RunClock(clock.monotonic_ns)
    runner = LiveGoal(goal, run_clock, PERIOD, lambda: False)
    stepped: list[int] = []
    for tick in range(40):
        clock.now += PERIOD
        run_clock.observe(round(tick * PERIOD * 1e9), clock.monotonic_ns(), tick)
        give_pose(goal, tick)
        turn(runner)
        if tick == 20:  # and before the next pose
            runner.submit(OperatorRequest("goal", Goal(1, 0.0, 2.0, None, ())))
            turn(runner)
            assert runner.goal.machine.goal_id == 1
        stepped.append(goal.cell.stepper.stepped)
    assert stepped == [*range(20), 21, *range(21, 40)]


def test_a_goal_without_poses_keeps_stepping_no_faster_than_the_platform(clock: Clock) -> None:
    goal = hosted("goal", GoalNode(GoalMachine(goal_rules(SYSTEM))))
    run_clock = RunClock(clock.monotonic_ns)
    run_clock.observe(0, clock.monotonic_ns(), 0)
    runner = LiveGoal(goal, run_clock, PERIOD, lambda: False)
    give_pose(goal, 0)
    for wait in 100 * (0.03, 0.05, 0.02, 0.045):
        turn(runner)
        clock.now += wait
    ticks = (clock.now - 1000.0) / PERIOD
    assert 0.8 * ticks < goal.cell.stepper.stepped <= ticks


def test_only_a_nodes_triggers_wake_it() -> None:
    mapper = hosted("mapper", Listener())
    LiveRunner(mapper, RunClock(), PERIOD, lambda: False)
    ringing = {feed.wire.input.name for feed in mapper.cell.feeds if feed.inlet.rings}
    assert ringing == {"scan.laser", "clear"}


def test_while_it_waits_for_other_inputs_of_a_tick_they_wake_it_too(clock: Clock) -> None:
    mapper = hosted("mapper", node := Listener())
    runner = LiveRunner(mapper, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    (track,) = [feed.inlet for feed in mapper.cell.feeds if feed.wire.input.name == "track"]
    give(mapper, "platform", "laser", SWEEP, 3)
    turn(runner)
    assert track.rings and not node.poses
    give_pose(mapper, 3)
    turn(runner)
    assert not track.rings and node.poses == [1]


def test_a_goal_fails_when_a_plugin_fails_20_times_in_a_row_in_one_process(clock: Clock) -> None:
    goal = hosted("goal", GoalNode(GoalMachine(goal_rules(SYSTEM))))
    runner = LiveGoal(goal, RunClock(clock.monotonic_ns), PERIOD, lambda: False)
    source = ("avoider", NAMES["avoider"])

    def fail(sequence: int) -> None:
        inlet = goal.cell.faults[source]
        report = StepReport("desired", (), (), True, 0, 0, 0, "it broke", "")
        inlet.give((report, Envelope(inlet.key, sequence, sequence, 0, 0, 0)))

    def told() -> str:
        runner.step("tick", runner.stepper.stepped + 1)
        return runner.goal.fault

    for sequence in range(1, 20):
        fail(sequence)
    assert not told()
    fail(1)  # its process restarted
    assert not told()
    for sequence in range(2, 21):
        fail(sequence)
    assert told() == f"avoider {NAMES['avoider']} failed 20 times in a row: it broke"


def test_faults_and_their_end_are_published_on_their_own_port() -> None:
    mapper = hosted("mapper", Listener())
    runner = LiveRunner(mapper, RunClock(), PERIOD, lambda: False)
    assert mapper.cell.fault is not None
    told: list[str] = []
    for number, fault in enumerate(("", "it broke", "it broke", "", "")):
        runner.fault = fault
        runner.tell([], Tick(number, 0.0, 0, 0), "scan.laser", ())
        told.append(mapper.cell.fault.last[0].fault if mapper.cell.fault.last else "nothing")  # type: ignore[attr-defined]
    assert mapper.cell.fault.sequence == 3 and told == ["nothing", "it broke", "it broke", "", ""]
