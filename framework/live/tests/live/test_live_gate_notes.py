"""The live gate: what it records, what wakes it, and what it keeps of operators and other nodes."""

from __future__ import annotations

from typing import Any

import pytest
from gate_rig import (
    AHEAD,
    GOAL,
    KEYS,
    MS,
    ORIGIN,
    OTHER,
    PLATFORM,
    STILL,
    SYSTEM,
    Gate,
    at,
    command,
    driving,
    follow,
    last,
    published,
    rings,
    stamped,
    stepped,
)  # fmt: skip
from navloom.engine.nodes.executor_inputs import GateTold, Obeyed
from navloom.messages import (
    Command,
    Drive,
    GateStatus,
    Odometry,
    OperatorRequest,
    PortMark,
    StepReport,
    StopReason,
    TrackingCommand,
)
from navloom.navigation.status_words import why_stopped
from navloom_live.live.live_gate import BETWEEN
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import Widening, all_sources
from navloom_live.live.mailbox import Inlet

# --- what it records --------------------------------------------------------------------------------------------------


def test_a_chain_is_timed_from_its_stamp_until_its_last_command_even_beyond_the_next_tick() -> None:
    gate = driving()
    gate.runner.chains_s.clear()
    at(gate, 150)
    gate.tick(3)
    command(gate, "controller", tick=3)
    at(gate, 200)
    gate.tick(4)
    at(gate, 207)
    command(gate, "avoider", tick=3)
    gate.look()
    assert list(gate.runner.chains_s) == pytest.approx([0.057])
    at(gate, 213)
    command(gate, "controller", "avoider", tick=4)
    gate.look()
    at(gate, 216)
    gate.look()
    assert gate.runner.chains_s[0] == pytest.approx(0.057) and len(gate.runner.chains_s) <= 2
    assert gate.runner.chains_s.maxlen == 1000


def test_a_chain_of_a_robot_that_follows_nothing_any_more_is_not_timed() -> None:
    gate = driving()
    gate.runner.chains_s.clear()
    at(gate, 150)
    gate.tick(3)
    gate.give(GOAL, "drive", Drive(0, 0, None, True), 3)
    at(gate, 160)
    gate.look()
    assert list(gate.runner.chains_s) == []
    gate.give(GOAL, "drive", Drive(2, 2, None, False), 4)
    at(gate, 200)
    gate.tick(4)
    at(gate, 204)
    command(gate, "controller", "avoider", tick=4)
    gate.look()
    assert list(gate.runner.chains_s) == pytest.approx([0.004])


def test_a_restart_of_the_run_clock_ends_a_chain_and_lets_the_selection_apply() -> None:
    gate = driving()
    at(gate, 150)
    gate.tick(3)
    assert gate.runner._chain is not None
    gate.node._from_tick = 9
    gate.runner.begin_anew(0)
    assert gate.runner._chain is None and gate.node._from_tick == 0


def test_what_wakes_it() -> None:
    gate = Gate()
    assert rings(gate) == {"drive", "recovering", "recovery"}
    gate.runner.act()
    assert rings(gate) == {"drive", "recovering", "recovery", "odometry"}
    follow(gate)
    assert rings(gate) == {"drive", "recovering", "recovery", "avoider"}
    gate.clock.now = 50 * MS
    gate.tick(1)
    command(gate, "avoider", tick=1)
    gate.look()
    assert rings(gate) == {"drive", "recovering", "recovery", "controller"}


def test_a_selection_is_announced_two_ticks_before_it_applies() -> None:
    gate = stamped()
    gate.tick(0)
    gate.report(OTHER, 5, 0)
    gate.runner.obey(OperatorRequest("swap", None, *OTHER))
    at(gate, 50)
    gate.tick(1)
    assert last(gate, "selection").epoch == 1 and last(gate, "selection").from_tick == 3


def test_commands_derive_from_the_stamp_of_what_they_pass_on() -> None:
    gate = driving()
    at(gate, 150)
    gate.tick(3)
    at(gate, 170.001)
    gate.look()
    found = gate.hosted.cell.outlets["command"].last
    assert found is not None and found[1].cause_ns == 100 * MS and found[1].stamp_ns == 150 * MS


# --- operators --------------------------------------------------------------------------------------------------------


def test_a_request_is_recorded_with_the_operators_command_at_that_time() -> None:
    gate = stamped()
    gate.runner.obey(OperatorRequest("release"))
    gate.give(("operator", "main"), "command", Command(AHEAD), 0, sequence=7)
    gate.runner.take_in()
    gate.runner.obey(OperatorRequest("swap", None, *OTHER))
    assert gate.node.obeyed == [Obeyed("release", "", "", 0), Obeyed("swap", *OTHER, 7)]


def test_a_speed_limit_is_recorded_in_each_step() -> None:
    gate = stamped()
    gate.node.gate.speed_limit = 0.25
    gate.tick(0)
    assert GateTold.of(gate.node.told).speed_limit == 0.25


def test_released_is_only_the_command_of_before() -> None:
    gate = stamped()
    gate.give(("operator", "main"), "command", Command(AHEAD), 0)
    gate.tick(0)
    assert last(gate).source == "operator"
    gate.runner.obey(OperatorRequest("release"))
    at(gate, 50)
    gate.tick(1)
    assert last(gate).source == "none"
    gate.give(("operator", "main"), "command", Command(AHEAD), 2)
    at(gate, 100)
    gate.tick(2)
    assert last(gate).source == "operator"


# --- other nodes ------------------------------------------------------------------------------------------------------


def test_the_active_instance_that_waits_for_a_stream_is_the_reason_of_a_stop() -> None:
    gate = stamped()
    active = ("avoider", gate.node.selected["avoider"])
    gate.runner._may_wait[:] = [OTHER, active]
    for source in (OTHER, active):
        gate.give(source, "step", StepReport("", (), (), True, 0, 0, 0, "", f"{source[1]} for maps"), 0)
    gate.tick(0)
    assert last(gate).reason == f"waits: {active[1]} for maps"
    gate.give(active, "step", StepReport("tick", (), (), True, 0, 0, 0, "", f"{active[1]} for maps"), 1)
    at(gate, 50)
    gate.tick(1)
    assert last(gate).reason == "no_trajectory"


def test_a_dead_alternative_is_forgotten_whether_its_report_was_read_or_not() -> None:
    gate = stamped()
    gate.tick(0)
    gate.report(OTHER, 5, 0)
    assert gate.node.is_warm(*OTHER)
    gate.lose(OTHER)
    gate.look()
    gate.begin(OTHER)
    assert not gate.node.is_warm(*OTHER)
    gate.report(OTHER, 6, 1)
    gate.lose(OTHER)
    gate.look()
    gate.begin(OTHER)
    assert not gate.node.is_warm(*OTHER)


@pytest.mark.parametrize(
    ("marks", "enabled", "is_warm"),
    [((PortMark("command", 1),), True, True), ((PortMark("command", 0),), True, False),
     ((PortMark("command", 1),), False, False), ((PortMark("diagnostics", 3),), True, False), ((), True, False)],
)  # fmt: skip
def test_an_instance_is_warm_once_it_has_published_its_command(
    marks: tuple[PortMark, ...], enabled: bool, is_warm: bool
) -> None:
    gate = stamped()
    gate.give(OTHER, "step", StepReport("tick", (), marks, enabled, 0, 0, 0, "", ""), 0)
    assert gate.node.is_warm(*OTHER) is is_warm


def test_an_instance_without_reports_is_not_warm() -> None:
    assert not stamped().node.is_warm("avoider", "nobody")


def test_a_fault_between_two_ticks_is_noted_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    gate = driving()
    told: list[tuple[str, int, float]] = []

    def breaks(tick: Any) -> None:
        raise ValueError("broke")

    monkeypatch.setattr(gate.node, "check", breaks)
    monkeypatch.setattr(
        gate.runner, "tell", lambda outputs, tick, trigger, read: told.append((trigger, tick.number, tick.time))
    )
    at(gate, 110)
    gate.look()
    assert "broke" in gate.runner.fault and gate.runner.faulted == 1 and told == [(BETWEEN, 2, pytest.approx(0.1))]


@pytest.mark.parametrize("role", ["avoider", "operator"])
def test_an_added_instance_is_needed_if_its_role_is(role: str) -> None:
    gate = stamped()
    source: Source = (role, "third")
    report = Inlet(KEYS.port(*source, "step"), gate.hosted.cell.mailbox, 1)
    gate.runner.admit(Widening(source, (), {source: report}, {}, False))
    assert (source in gate.runner._needed) is (role == "avoider")
    assert source in gate.runner._may_wait and gate.hosted.cell.reports[source] is report


def test_it_runs_until_the_process_ends_and_then_stops_with_the_last_tick() -> None:
    gate = stamped()
    gate.give(PLATFORM, "odometry", Odometry(100 * MS, ORIGIN, STILL), 2)
    at(gate, 100)
    turns = iter([False, True])
    gate.runner.ends = lambda: next(turns)
    gate.runner.run()
    assert stepped(gate) == 2
    found = gate.hosted.cell.outlets["command"].last
    assert found is not None and found[1].tick == 2 and found[1].stamp_ns == 100 * MS and published(gate) == 2
    unknown = stamped()
    unknown.runner.ends = lambda: True
    unknown.runner.run()
    found = unknown.hosted.cell.outlets["command"].last
    assert found is not None and (found[1].tick, found[1].stamp_ns) == (0, 0)


# --- two publishers of one stream -------------------------------------------------------------------------------------

CONTROLLER = ("controller", SYSTEM.config.controller.instance)
LIVES = ("0a~12~base", "0b~14~copy")


def two_controllers(gate: Gate, ticks: range) -> StopReason:
    """Two processes publish the controller's commands; returns the reason of the stop."""
    for tick in ticks:
        gate.give(CONTROLLER, "command", tracking(), tick, sequence=500 + tick)
        gate.give(CONTROLLER, "command", tracking(), tick, sequence=tick)
        gate.tick(tick)
    assert gate.runner.gate.gone is not None
    return gate.runner.gate.gone


def tracking() -> TrackingCommand:
    return TrackingCommand(AHEAD, 0.0, 0.0, 0.0)


def test_a_second_source_of_commands_stops_the_robot_and_the_reason_names_both_processes() -> None:
    gate = Gate()
    gate.has_stamps = True
    for life in LIVES:
        gate.begin(CONTROLLER, life=life)
    reason = two_controllers(gate, range(1, 6))
    name = " ".join(CONTROLLER)
    assert reason.text == f"rivals: {name} on host base (process 12) and on host copy (process 14)"
    status = GateStatus("none", "", True, False, reason, ())
    assert why_stopped(status)[0].endswith("and on host copy (process 14) publish the same stream")


def test_of_a_second_source_without_a_token_it_says_so() -> None:
    gate = Gate()
    gate.has_stamps = True
    gate.begin(CONTROLLER)
    assert "in two processes, of which one has announced no node" in two_controllers(gate, range(1, 6)).of


def test_a_restarted_controller_is_no_second_one() -> None:
    gate = Gate()
    gate.has_stamps = True
    gate.begin(*(source for source in all_sources(SYSTEM) if source[0] != "operator"))
    for tick in range(1, 12):
        gate.give(CONTROLLER, "command", tracking(), tick, sequence=500 + tick if tick < 6 else tick - 5)
        gate.tick(tick)
    assert gate.runner.gate.gone is None
