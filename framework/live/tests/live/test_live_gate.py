"""The live gate: when an instance may take over, and when it decides."""

from __future__ import annotations

from typing import Any

import pytest
from gate_rig import AHEAD, ORIGIN, OTHER, PERIOD, PLATFORM, SHADOW, STILL, SYSTEM, Gate, follow, last, rings
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.messages import Command, Drive, Odometry, OperatorRequest, Pose2D, StopReason, Twist2D
from navloom_live.live.live_node_builder import all_sources
from navloom_live.timing import command_wait, rate_of_wait


def test_an_instance_that_died_must_warm_up_again_before_it_takes_over() -> None:
    gate = Gate()
    gate.report(OTHER, 5, 0)
    gate.tick(0)
    gate.lose(OTHER)
    gate.runner.obey(OperatorRequest("swap", None, *OTHER))
    gate.tick(1)
    assert gate.node.pending == ["avoider other"] and gate.node.epoch == 0
    gate.begin(OTHER)
    gate.tick(2)
    assert gate.node.pending == ["avoider other"]
    gate.report(OTHER, 1, 3)
    gate.tick(3)
    assert gate.node.pending == [] and gate.node.epoch == 1 and gate.node.selected["avoider"] == "other"


def test_after_a_restart_of_the_run_clock_the_gate_decides_by_the_new_one() -> None:
    gate = Gate()
    gate.report(OTHER, 5, 0)
    for tick in (72_000, 3):
        gate.tick(tick)
    assert gate.hosted.cell.stepper.stepped == 3
    gate.runner.obey(OperatorRequest("swap", None, *OTHER))
    gate.tick(4)
    assert gate.node.epoch == 1


def test_a_stop_requested_while_stopped_is_published_at_once() -> None:
    """A stop that is not published is not remembered, and the next gate would drive."""
    gate = Gate()
    gate.tick(0)
    gate.runner.deadline = -1.0  # nothing comes from the platform
    gate.tick(0)
    gate.runner.obey(OperatorRequest("stop"))
    gate.runner.act()
    status = gate.hosted.cell.outlets["status"].last
    assert status is not None and status[0].reason == "operator" and status[0].latched  # type: ignore[attr-defined]
    sequence = status[1].sequence
    gate.runner.act()
    assert gate.hosted.cell.outlets["status"].sequence == sequence


def test_its_last_status_says_that_it_ends() -> None:
    gate = Gate()
    gate.tick(0)
    gate.runner.ends = lambda: True
    gate.runner.run()
    status = gate.hosted.cell.outlets["status"].last
    assert status is not None and status[0].reason == "ending"  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("period", "seconds"), [(0.05, 0.02), (0.02, 0.008), (0.0125, 0.008), (0.01, 0.008), (0.005, 0.004)]
)
def test_it_waits_two_fifths_of_a_period_but_8_ms_where_that_is_less(period: float, seconds: float) -> None:
    assert command_wait(period) == pytest.approx(seconds)


@pytest.mark.parametrize("seconds", [0.004, 0.008, 0.0081, 0.02])
def test_the_rate_it_holds_is_the_highest_at_which_it_waits_long_enough(seconds: float) -> None:
    rate = rate_of_wait(seconds)
    assert command_wait(1.0 / rate) >= seconds * (1.0 - 1e-9)
    assert command_wait(1.0 / (1.01 * rate)) < seconds


def test_it_records_how_long_the_commands_of_a_tick_took() -> None:
    gate = Gate()
    gate.give(("goal", "main"), "drive", Drive(1, 1, None, False), 0)
    for tick, late in ((1, 4), (2, 30)):
        gate.tick(tick)
        gate.clock.now += late * 1_000_000
        for role in ("controller", "avoider"):
            gate.give((role, gate.node.selected[role]), "command", Command(STILL), tick)
        gate.look()
    assert list(gate.runner.chains_s) == pytest.approx([0.004, 0.03])


def test_after_a_restart_of_the_platform_it_waits_for_a_later_step_of_the_goal() -> None:
    gate = Gate()
    gate.begin(*all_sources(SYSTEM))
    gate.report(("goal", "main"), 1, 0)
    gate.tick(0)
    assert gate.node.gone is None
    gate.give(PLATFORM, "odometry", Odometry(round(20 * PERIOD * 1e9), ORIGIN, STILL), 20, sequence=0)
    gate.look()
    assert gate.node.gone == StopReason("goal_halted")
    gate.report(("goal", "main"), 2, 19)  # a step without a pose, which does not reflect the restart
    gate.look()
    assert gate.node.gone == StopReason("goal_halted")
    gate.report(("goal", "main"), 3, 20)  # nor is one in the same tick a later one
    gate.look()
    assert gate.node.gone == StopReason("goal_halted")
    gate.report(("goal", "main"), 4, 21)
    gate.look()
    assert gate.node.gone is None


def test_a_platform_may_restart_at_tick_0() -> None:
    gate = Gate()
    gate.begin(*all_sources(SYSTEM))
    gate.tick(300)
    gate.give(PLATFORM, "odometry", Odometry(0, ORIGIN, STILL), 0)
    gate.look()
    assert gate.node.gone == StopReason("goal_halted")
    gate.report(("goal", "main"), 1, 1)
    gate.look()
    assert gate.node.gone is None


def test_after_a_restart_of_the_platform_the_monitor_begins_again() -> None:
    """Odometry alone cannot show a restart that puts the robot back by 4 m within 0.9 s."""
    gate = Gate()
    monitor = gate.node.gate.monitor
    assert monitor is not None

    def stand(tick: int, x: float, sequence: int) -> None:
        odometry = Odometry(round(tick * PERIOD * 1e9), Pose2D(x, 0.0, 0.0), STILL)
        gate.give(PLATFORM, "odometry", odometry, tick, sequence)
        gate.look()

    for tick in range(81):
        stand(tick, 0.05 * tick, tick + 1)
    stand(98, 0.0, 1)
    stand(99, 0.0, 2)
    assert monitor.judge(Twist2D(0.02, 0.0, 0.0), 0.0, 99 * PERIOD).kind == ""


def test_only_the_last_command_of_a_tick_wakes_it() -> None:
    gate = Gate()
    gate.tick(0)
    assert "odometry" in rings(gate) and not {"controller", "avoider"} & rings(gate)  # nothing is followed
    gate = Gate()
    follow(gate)
    assert "avoider" in rings(gate) and not {"controller", "odometry"} & rings(gate)
    gate.give(("avoider", gate.node.selected["avoider"]), "command", Command(AHEAD), 1)
    gate.tick(1)
    assert "controller" in rings(gate)  # the command that is still missing
    gate.give(("controller", gate.node.selected["controller"]), "command", Command(AHEAD), 1)
    gate.look()
    gate.give(("controller", gate.node.selected["controller"]), "command", Command(AHEAD), 2)
    gate.give(("avoider", gate.node.selected["avoider"]), "command", Command(AHEAD), 2)
    gate.look()
    assert gate.hosted.cell.stepper.stepped == 1 and "odometry" in rings(gate)  # the commands overtook their tick


def test_it_decides_again_when_its_inputs_go_stale() -> None:
    gate = Gate()
    follow(gate)
    began_ns, looks = gate.clock.now, 0
    while not reason(gate):
        gate.clock.now += max(1, round(gate.runner.wait_time() * 1e9))
        gate.look()
        looks += 1
    # Stamps are 0 in this rig: 100 ms after that the platform is silent, and both commands are stale.
    assert looks < 10  # of 10 ms each it would be as many
    assert 0.0 < (gate.clock.now - began_ns) * 1e-9 <= 0.1


GOAL = ("goal", "main")
LOCALIZER = ("localizer", SYSTEM.config.role_table("localizer").instance)
THINKING = (GOAL, LOCALIZER)


@pytest.fixture
def live() -> Gate:
    return driving()


def driving(*changes: str) -> Gate:
    """A gate whose robot has driven for a second; the goal steps when the test says so."""
    system = assemble(load_config("paper", ["gate.sensor_timeout=60", *(changes or [SHADOW])]))
    gate = Gate(system)
    gate.has_stamps, gate.goal_steps = True, False
    gate.begin(*[source for source in all_sources(system) if source not in THINKING])
    gate.begin(*THINKING, life="think")
    gate.give(GOAL, "drive", Drive(1, 1, None, False), 0)
    for tick in range(20):
        go_on(gate, tick, steps=True)
    assert reason(gate) == ""
    return gate


def go_on(gate: Gate, tick: int, steps: bool) -> None:
    """One tick, whose commands arrive at once; the goal steps or does not."""
    gate.clock.now = round(tick * PERIOD * 1e9)
    if steps:
        gate.report(GOAL, 0, tick)
    for role in ("controller", "avoider"):
        gate.give((role, gate.node.selected[role]), "command", Command(AHEAD), tick)
    gate.tick(tick)


def reason(gate: Gate) -> str:
    status: Any = gate.hosted.cell.outlets["status"].last
    return str(status[0].reason)


def stop_after(gate: Gate, tick: int = 19) -> float:
    """Time from the last step of the goal, in `tick`, until the gate stops, s; the others go on."""
    began = round(tick * PERIOD * 1e9)
    while not reason(gate) and gate.clock.now < began + 1e9:
        due = round((tick + 1) * PERIOD * 1e9)
        gate.clock.now = min(due, gate.clock.now + max(1, round(gate.runner.wait_time() * 1e9)))
        if gate.clock.now == due:
            tick += 1
            go_on(gate, tick, steps=False)
        else:
            gate.look()
    return (gate.clock.now - began) * 1e-9


def test_a_goal_that_no_longer_steps_stops_the_robot_within_150_ms(live: Gate) -> None:
    assert 0.12 < stop_after(live) < 0.125
    assert reason(live) == "stale: goal main"
    go_on(live, 22, steps=True)
    assert reason(live) == ""


def test_a_goal_that_steps_with_each_pose_of_a_slow_localizer_is_in_time() -> None:
    other = 'alternative=[{name="slow", role="localizer", plugin="odometry", rate_hz=5}]'
    for change in ("localizer.rate_hz=5", other):
        gate = driving(change, "gate.stop_deadline=0.3")
        assert 0.47 < stop_after(gate) < 0.475
        assert reason(gate) == "stale: goal main"


def test_a_goal_on_another_host_may_be_silent_for_half_a_second() -> None:
    hosts = 'live={ router = "tls/10.0.0.1:7447", hosts = { base = ["robot", "drive", "safe"], brain = ["think"] } }'
    gate = driving(hosts)
    assert 0.5 < stop_after(gate) < 0.505


def test_tokens_that_are_reported_as_lost_while_their_process_steps_do_not_stop_the_robot(live: Gate) -> None:
    live.lose(*THINKING, life="think")
    for tick in range(20, 30):
        go_on(live, tick, steps=True)
        assert reason(live) == ""
    assert 0.0625 < stop_after(live, 29) < 0.065
    assert reason(live) == f"gone: localizer {LOCALIZER[1]}"


def test_a_shadow_that_claims_the_life_of_another_process_does_not_keep_it_alive(live: Gate) -> None:
    live.begin(OTHER, life="think")
    live.lose(*THINKING, life="think")
    for tick in (20, 21):
        live.report(OTHER, 0, tick)
        go_on(live, tick, steps=False)
    assert reason(live) == f"gone: localizer {LOCALIZER[1]}"


def test_a_lost_token_of_another_process_stops_the_robot_at_once(live: Gate) -> None:
    live.lose(LOCALIZER, life="think")
    live.begin(LOCALIZER, life="alone")
    go_on(live, 20, steps=True)
    assert reason(live) == ""
    live.lose(LOCALIZER, life="alone")
    go_on(live, 21, steps=True)
    assert reason(live) == f"gone: localizer {LOCALIZER[1]}"


def test_a_process_without_tokens_is_gone_62_5_ms_after_its_last_message(live: Gate) -> None:
    """The last messages are of tick 19; only the localizer's process is in doubt."""
    live.lose(*THINKING, life="think")
    localizer = StopReason("gone", " ".join(LOCALIZER))
    for before_ns, gone, wait in ((2, None, 2e-9), (1, None, 1e-9), (0, localizer, None)):
        live.clock.now = 950_000_000 + 62_500_000 - before_ns
        live.look()
        assert live.node.gone == gone
        if wait is None:  # the next that may happen: the tick and its commands at 1.02 s
            assert live.runner.wait_time() == pytest.approx(0.0075 + 0.0002)
        else:
            assert live.runner.wait_time() == pytest.approx(wait + 0.0002, abs=1e-10)


def test_a_command_shows_that_its_process_runs(live: Gate) -> None:
    """Controller and avoider send no reports to the gate."""
    controller = ("controller", live.node.selected["controller"])
    live.lose(controller, life="a")
    for tick in range(20, 25):
        go_on(live, tick, steps=True)
        assert reason(live) == ""
    live.clock.now += 63_000_000
    live.look()
    assert live.node.gone == StopReason("gone", " ".join(controller))


def command(gate: Gate) -> tuple[float, int]:
    """The newest command, m/s, and the platform's stamp that it derives from, ms."""
    sent: Any = gate.hosted.cell.outlets["command"].last
    return round(sent[0].twist.vx, 3), round(sent[1].cause_ns * 1e-6)


def end_drive(gate: Gate, tick: int) -> None:
    """The goal ends its drive between two ticks; controller and avoider then publish nothing."""
    gate.clock.now = round((tick - 0.5) * PERIOD * 1e9)
    gate.give(GOAL, "drive", Drive(0, 0, None, False), tick)
    gate.look()


def idle(gate: Gate, tick: int, steps: bool = True) -> None:
    """One tick without commands."""
    gate.clock.now = round(tick * PERIOD * 1e9)
    if steps:
        gate.report(GOAL, 0, tick)
    gate.tick(tick)


def test_the_ramp_goes_on_with_the_ticks_after_the_drive_is_gone(live: Gate) -> None:
    """From 0.1 m/s by 1 m/s² · 50 ms, each command from the newest stamp."""
    assert command(live) == (0.1, 950)
    end_drive(live, 20)
    assert command(live) == (0.1, 950)  # the ramp begins with the next tick
    idle(live, 20)
    assert command(live) == (0.05, 1000) and not last(live).stopped and reason(live) == "no_trajectory"
    idle(live, 21)
    assert command(live) == (0.0, 1050) and last(live).stopped


def test_a_latched_stop_of_a_driving_robot_is_told_at_once_and_braked_by_a_ramp(live: Gate) -> None:
    live.runner.obey(OperatorRequest("stop"))
    live.look()
    told = last(live)
    assert (told.latched, told.stopped, told.reason) == (True, False, "operator") and command(live) == (0.1, 950)
    go_on(live, 20, steps=True)
    go_on(live, 21, steps=True)
    assert command(live) == (0.0, 1050) and last(live).stopped


def test_a_silent_platform_during_a_ramp_is_a_step_to_zero_within_150_ms(live: Gate) -> None:
    end_drive(live, 20)
    idle(live, 20)
    began = live.clock.now
    while command(live)[0] and live.clock.now < began + 1e9:
        live.clock.now += max(1, round(live.runner.wait_time() * 1e9))
        live.look()
    assert 0.1 <= (live.clock.now - began) * 1e-9 < 0.15
    assert (last(live).stopped, reason(live)) == (True, "silent: platform")


def test_a_node_that_dies_during_a_ramp_is_a_step_to_zero_at_once(live: Gate) -> None:
    end_drive(live, 20)
    idle(live, 20)
    controller = ("controller", live.node.selected["controller"])
    live.lose(controller)
    live.lose(*[source for source in all_sources(SYSTEM) if source not in THINKING])
    live.clock.now += 80_000_000
    live.look()
    assert command(live)[0] == 0.0 and reason(live).startswith("gone: ")
