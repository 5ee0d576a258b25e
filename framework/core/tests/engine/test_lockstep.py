"""The lockstep executor with toy plugins: runs are repeatable, and events take effect."""

from __future__ import annotations

import hashlib
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import toys
from navloom.config import ConfigError
from navloom.engine.trace import TraceEntry, TraceError, read_trace
from navloom.messages import Command, GateStatus, GoalResult, Rollouts, Selection, StepRecord
from navloom.plugins import PluginError
from navloom.roles import Role
from navloom.runs.episode import Episode, run_episode
from toys import discovery, toy_config


def drive(tmp_path: Path, *overrides: str, more: str = "", **options: object) -> Episode:
    return run_episode(toy_config(tmp_path, *overrides, more=more), discovery=discovery(), **options)  # type: ignore[arg-type]


def traced(tmp_path: Path, *overrides: str, more: str = "") -> tuple[Episode, list[TraceEntry]]:
    file = tmp_path / "trace.bin"
    with file.open("wb") as out:
        episode = drive(tmp_path, *overrides, more=more, trace=out)
    assert hashlib.sha256(file.read_bytes()).hexdigest() == episode.log.trace_sha256
    return episode, list(read_trace(file))


ALTERNATIVE = """
[[alternative]]
name = "slow"
role = "avoider"
plugin = "toy_bystander"
share = 0.1
shadow = {shadow}
"""


def test_it_reaches_the_goal_in_the_expected_time(tmp_path: Path) -> None:
    episode = drive(tmp_path)
    assert episode.summary()["truly_reached"]
    # 3 m less the tolerance of 0.2 m at 0.2 to 0.4 m/s.
    assert 7.0 < episode.log.ticks * 0.05 < 14.0
    assert episode.trail.path_length == pytest.approx(2.8 + 0.08, abs=0.06)  # it brakes from 0.4 m/s


def test_the_same_seed_gives_the_same_trace_and_another_seed_another_trace(tmp_path: Path) -> None:
    first = drive(tmp_path).log.trace_sha256
    assert drive(tmp_path).log.trace_sha256 == first
    assert drive(tmp_path, "run.seed=2").log.trace_sha256 != first


def test_without_noise_two_seeds_agree(tmp_path: Path) -> None:
    quiet = "platform.noise=false"
    assert drive(tmp_path, quiet).log.trace_sha256 == drive(tmp_path, quiet, "run.seed=2").log.trace_sha256


def test_a_parameter_that_matters_changes_the_trace(tmp_path: Path) -> None:
    assert (
        drive(tmp_path, "controller.gain=2.0", "navigation.goal.y=1.0").log.trace_sha256
        != drive(tmp_path, "navigation.goal.y=1.0").log.trace_sha256
    )


@pytest.mark.parametrize("shadow", ["true", "false"])
def test_a_shadow_or_a_waiting_alternative_does_not_change_the_trace(tmp_path: Path, shadow: str) -> None:
    plain = drive(tmp_path).log.trace_sha256
    assert drive(tmp_path, more=ALTERNATIVE.format(shadow=shadow)).log.trace_sha256 == plain


class Everything:
    """An observer of everything."""

    wants = None
    wants_steps = True

    def __init__(self) -> None:
        self.ports: set[str] = set()
        self.steps: list[StepRecord] = []

    def on_message(self, role: str, instance: str, active: bool, port: str, message: object, at: object) -> None:
        self.ports.add(f"{role}/{instance}/{port}/{'active' if active else 'shadow'}")

    def on_step(self, record: StepRecord) -> None:
        self.steps.append(record)


def test_an_observer_sees_shadows_and_steps_and_changes_nothing(tmp_path: Path) -> None:
    looker = Everything()
    more = ALTERNATIVE.format(shadow="true")
    assert drive(tmp_path, more=more, observers=[looker]).log.trace_sha256 == drive(tmp_path).log.trace_sha256
    assert "avoider/slow/handover/shadow" in looker.ports and "gate/main/command/active" in looker.ports


def test_step_records_name_what_was_consumed(tmp_path: Path) -> None:
    looker = Everything()
    drive(tmp_path, observers=[looker])
    (localizer,) = [r for r in looker.steps if (r.role, r.tick) == ("localizer", 3)]
    assert localizer.trigger == "odometry" and dict(localizer.consumed)["odometry"] == (4,)
    (platform,) = [r for r in looker.steps if (r.role, r.tick) == ("platform", 3)]
    # In tick 3 the platform reads the gate's command of tick 2, the third command.
    assert dict(platform.consumed)["command"] == (3,)
    silent = [r for r in looker.steps if r.role == "recovery" and r.tick == 3]
    assert len(silent) == 1


def test_the_platform_acts_on_the_command_of_the_tick_before(tmp_path: Path) -> None:
    _, entries = traced(tmp_path)
    commands = {e.tick: e.message.twist.vx for e in entries if isinstance(e.message, Command) and e.role == "gate"}
    speeds = {e.tick: e.message.twist.vx for e in entries if e.port == "odometry"}  # type: ignore[attr-defined]
    assert speeds[0] == 0.0
    assert all(speeds[tick + 1] == commands[tick] for tick in range(max(speeds)))


def test_a_trace_is_sorted_within_a_tick_and_has_no_sequence_numbers(tmp_path: Path) -> None:
    _, entries = traced(tmp_path)
    keys = [(e.tick, e.role, e.instance, e.port) for e in entries]
    assert keys == sorted(keys)
    assert {e.envelope.sequence for e in entries} == {0}


def test_latency_delays_what_a_node_publishes(tmp_path: Path) -> None:
    _, prompt = traced(tmp_path)
    _, late = traced(tmp_path, "planner.latency=0.12")
    first = [next(e for e in entries if e.port == "path") for entries in (prompt, late)]
    # 0.12 s is three ticks of 0.05 s; the envelope still says when it was made.
    assert first[1].tick - first[0].tick == 3
    assert first[1].envelope.stamp_ns == first[0].envelope.stamp_ns


LATE = """
[[alternative]]
name = "late"
role = "controller"
plugin = "toy_chaser"
latency = 0.15
[[event]]
at = 1.0
do = "swap"
role = "controller"
name = "late"
"""


def test_too_much_latency_in_the_control_chain_never_drives(tmp_path: Path) -> None:
    episode, entries = traced(tmp_path, "run.stop_after=5.0", more=LATE)
    reasons = {e.message.reason for e in entries if isinstance(e.message, GateStatus)}
    assert episode.result.outcome == "timeout" and "stale: controller late" in reasons
    assert episode.trail.path_length < 0.5


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["controller.latency=0.15"], "controller.latency: is 0.15: the controller's commands are up to 0.15 s old"),
        (["localizer.latency=0.05", "avoider.latency=0.1"], "avoider.latency: is 0.1: the avoider's commands are"),
        (["controller.rate_hz=5.0"], "controller.rate_hz: is 5: the controller's commands are up to 0.15 s old"),
        (["mapper.latency=10.0"], "mapper.latency: is 10 s; expected less than navigation.map_timeout = 10 s"),
        (["navigation.speed=[0.6,0.7]"], "navigation.speed: begins with 0.6 m/s, more than robot.max_linear = 0.5 m/s"),
        (["sensor=[]"], "mapper.plugin: toy_blank needs a sensor that gives RangeScan, and there is no [[sensor]]"),
        (["mapper.sensors=[]"], "mapper.sensors: toy_blank needs a sensor that gives RangeScan, and this list"),
    ],
    ids=["latency", "two-latencies", "rate", "map", "speed", "no-sensor", "sensor-list"],
)  # fmt: skip
def test_a_config_that_cannot_drive_is_refused_before_the_run(tmp_path: Path, changes: list[str], said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        drive(tmp_path, *changes)
    assert said in str(caught.value)


def test_with_the_hand_over_never_the_avoider_needs_no_sensor(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"avoider.plugin: .* or set navigation.handover = \"never\""):
        drive(tmp_path, "sensor=[]", "mapper.plugin=known_map")
    drive(tmp_path, "sensor=[]", "mapper.plugin=known_map", 'navigation.handover="never"')


def test_a_slower_node_steps_at_its_rate(tmp_path: Path) -> None:
    _, entries = traced(tmp_path, "controller.rate_hz=10.0")
    ticks = [e.tick for e in entries if (e.role, e.port) == ("controller", "command")]
    assert {tick % 2 for tick in ticks} == {0} and len(ticks) > 20


def test_a_rate_that_does_not_divide_is_refused_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"controller.rate_hz: 15 does not divide the tick rate of 20 Hz; the nearest"
    ):
        drive(tmp_path, "controller.rate_hz=15.0")


def test_swap_by_event_changes_who_drives_at_one_tick(tmp_path: Path) -> None:
    event = '[[event]]\nat = 2.0\ndo = "swap"\nrole = "avoider"\nname = "slow"\n'
    episode, entries = traced(tmp_path, 'navigation.handover="always"', more=ALTERNATIVE.format(shadow="true") + event)
    (selection,) = [e for e in entries if isinstance(e.message, Selection) and e.message.epoch == 1]
    assert (selection.tick, selection.message.from_tick) == (40, 41)  # type: ignore[attr-defined]
    avoiders = {e.tick: e.instance for e in entries if (e.role, e.port) == ("avoider", "command")}
    assert avoiders[40] == "toy_bystander" and avoiders[41] == "slow"
    assert all((name == "slow") == (tick >= 41) for tick, name in avoiders.items())
    assert episode.summary()["swaps"] == 1


def test_a_waiting_alternative_warms_up_before_it_takes_over(tmp_path: Path) -> None:
    event = '[[event]]\nat = 2.0\ndo = "swap"\nrole = "avoider"\nname = "slow"\n'
    _, entries = traced(tmp_path, 'navigation.handover="always"', more=ALTERNATIVE.format(shadow="false") + event)
    commands = [e.tick for e in entries if (e.role, e.port) == ("gate", "command")]
    assert commands == list(range(commands[-1] + 1))
    assert {e.instance for e in entries if (e.role, e.port) == ("avoider", "command")} == {"toy_bystander", "slow"}


def test_a_swap_of_the_planner_requests_a_plan(tmp_path: Path) -> None:
    more = '[[alternative]]\nname = "other"\nrole = "planner"\nplugin = "toy_straight"\nshadow = false\n'
    event = '[[event]]\nat = 2.0\ndo = "swap"\nrole = "planner"\nname = "other"\n'
    episode, entries = traced(tmp_path, more=more + event)
    assert {e.instance for e in entries if e.port == "path"} == {"toy_straight", "other"}
    assert episode.summary()["truly_reached"]


def test_a_mapper_maps_before_it_is_swapped_in_and_its_swap_triggers_a_plan(tmp_path: Path) -> None:
    more = '[[alternative]]\nname = "other"\nrole = "mapper"\nplugin = "toy_blank"\nsize = 50\n'
    event = '[[event]]\nat = 2.0\ndo = "swap"\nrole = "mapper"\nname = "other"\n'
    episode, entries = traced(tmp_path, more=more + event)
    plans = [e.tick for e in entries if e.port == "plan"]
    assert len(plans) == 2 and plans[1] > 40
    assert episode.summary()["truly_reached"]


def test_stop_latches_until_resume_and_then_the_goal_continues(tmp_path: Path) -> None:
    events = '[[event]]\nat = 2.0\ndo = "stop"\n[[event]]\nat = 4.0\ndo = "resume"\n'
    episode, entries = traced(tmp_path, more=events)
    commands = {e.tick: e.message.twist.vx for e in entries if (e.role, e.port) == ("gate", "command")}  # type: ignore[attr-defined]
    ramp = [commands[tick] for tick in range(39, 49)]  # from 0.4 m/s by 1 m/s² · 0.05 s a tick
    assert ramp == pytest.approx([0.4, 0.35, 0.3, 0.25, 0.2, 0.15, 0.1, 0.05, 0.0, 0.0])
    assert not any(commands[tick] for tick in range(48, 80)) and commands[80] > 0.0
    assert episode.summary()["truly_reached"] and episode.summary()["gate_stops"] == 1


def test_a_stop_that_is_not_resumed_ends_stopped(tmp_path: Path) -> None:
    episode = drive(tmp_path, "run.stop_after=5.0", more='[[event]]\nat = 2.0\ndo = "stop"\n')
    assert episode.result.outcome == "stopped"


def test_cancel_stops_and_ends_cancelled(tmp_path: Path) -> None:
    episode, entries = traced(tmp_path, more='[[event]]\nat = 2.0\ndo = "cancel"\n')
    assert episode.result.outcome == "cancelled"
    commands = {e.tick: e.message.twist.vx for e in entries if (e.role, e.port) == ("gate", "command")}  # type: ignore[attr-defined]
    assert commands[39] == pytest.approx(0.4) and commands[40] == pytest.approx(0.35)
    assert (max(commands), commands[47]) == (48, pytest.approx(0.0))  # the run lasts until the robot stands


def test_pre_emption_keeps_driving_and_reaches_the_new_goal(tmp_path: Path) -> None:
    episode, entries = traced(tmp_path, more='[[event]]\nat = 2.0\ndo = "goal"\nx = 3.0\ny = 2.0\n')
    results = [e.message for e in entries if isinstance(e.message, GoalResult)]
    assert [(r.goal_id, r.outcome) for r in results] == [(1, "cancelled"), (2, "succeeded")]
    assert episode.summary()["truly_reached"]
    commands = {e.tick: e.message.twist.vx for e in entries if (e.role, e.port) == ("gate", "command")}  # type: ignore[attr-defined]
    assert all(commands[tick] > 0.0 for tick in range(30, 60))
    assert episode.result.place.y == pytest.approx(2.0, abs=0.25)


def test_pre_emption_without_a_plan_stops(tmp_path: Path) -> None:
    episode = drive(tmp_path, "planner.reach=10.0", more='[[event]]\nat = 2.0\ndo = "goal"\nx = 90.0\ny = 0.0\n')
    assert (episode.result.outcome, episode.result.reason) == ("rejected", "outside_map: too far")


def test_set_changes_parameters_between_two_ticks(tmp_path: Path) -> None:
    event = '[[event]]\nat = 2.0\ndo = "set"\nrole = "avoider"\nvalues = { share = 0.0 }\n'
    _, entries = traced(tmp_path, "run.stop_after=4.0", 'navigation.handover="always"', more=event)
    speeds = {e.tick: e.message.twist.vx for e in entries if (e.role, e.port) == ("avoider", "command")}  # type: ignore[attr-defined]
    assert speeds[39] > 0.0 and speeds[40] == 0.0


def test_a_set_that_does_not_fit_is_refused_before_the_run(tmp_path: Path) -> None:
    event = '[[event]]\nat = 2.0\ndo = "set"\nrole = "controller"\nvalues = { gain = 99.0 }\n'
    with pytest.raises(ConfigError, match=r"event.0.values: controller.gain: got 99.0, expected less than 10"):
        drive(tmp_path, more=event)


def test_contact_ends_in_collision(tmp_path: Path) -> None:
    episode = drive(tmp_path, "platform.touches_at=1.0")
    assert episode.result.outcome == "collision" and episode.summary()["collisions"] == 1


def test_a_plugin_that_breaks_ends_the_goal_with_its_name(tmp_path: Path) -> None:
    episode = drive(tmp_path, "controller.fails_at_ns=2000000000")
    assert episode.result.outcome == "error"
    assert re.fullmatch(r"controller toy_chaser failed: RuntimeError: broke \(toys\.py:\d+\)", episode.result.reason)


@pytest.mark.parametrize(
    ("answers", "text"),
    [
        ("none", "AnswerError: control() returned None, expected TrackingCommand"),
        ("twist", "AnswerError: control() returned Twist2D(vx=0.1, vy=0.0, wz=0.0), expected TrackingCommand"),
        ("exit", "SystemExit: 3 (toys.py:"),
    ],
)
def test_a_plugin_that_answers_with_another_type_is_blamed(tmp_path: Path, answers: str, text: str) -> None:
    episode = drive(tmp_path, f'controller.answers="{answers}"')
    assert episode.result.outcome == "error"
    assert episode.result.reason.startswith(f"controller toy_chaser failed: {text}")
    assert episode.log.faults == [episode.result.reason]


def test_a_shadow_that_breaks_does_not_end_the_goal(tmp_path: Path) -> None:
    more = '[[alternative]]\nname = "weak"\nrole = "controller"\nplugin = "toy_chaser"\nfails_at_ns = 2000000000\n'
    episode = drive(tmp_path, more=more)
    assert episode.summary()["truly_reached"]
    (fault,) = episode.log.faults
    assert fault.startswith("controller weak failed: RuntimeError: broke (toys.py:")
    assert episode.log.trace_sha256 == drive(tmp_path).log.trace_sha256


def test_a_goal_heading_is_turned_to(tmp_path: Path) -> None:
    episode = drive(tmp_path, "navigation.goal.heading_deg=90.0")
    assert episode.summary()["truly_reached"]
    assert episode.recorder.truth[-1][3] == pytest.approx(1.571, abs=0.1)


def test_points_on_the_way_are_passed(tmp_path: Path) -> None:
    episode = drive(tmp_path, "navigation.via=[{x=1.5,y=1.5}]")
    assert episode.summary()["truly_reached"]
    nearest = min((x - 1.5) ** 2 + (y - 1.5) ** 2 for _, x, y, *_ in episode.recorder.truth)
    assert nearest < 0.25**2


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("controller.gian=1.0", "controller.gian: unknown key; did you mean 'gain'?"),
        ("controller.gain=-1.0", "controller.gain: got -1.0, expected more than 0"),
        ("sensor.ear.kind=eye", "toy_robot has no sensor of kind 'eye'; known are ear"),
        ("navigation.goal.x=99.0", "navigation.goal: (99, 0) is outside the world empty"),
        ("world.ref=emty", "world.ref: world 'emty' does not exist; did you mean 'empty'?"),
    ],
)
def test_a_wrong_request_is_refused_before_the_run(tmp_path: Path, change: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        drive(tmp_path, change)
    assert said in str(caught.value)


def test_an_unknown_plugin_names_the_place_and_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(
        PluginError, match=r"avoider.plugin: no plugin 'avoider.toy_bystandr' is installed; did you mean"
    ):
        drive(tmp_path, "avoider.plugin=toy_bystandr")


def test_a_trace_cut_short_says_so(tmp_path: Path) -> None:
    out = io.BytesIO()
    drive(tmp_path, trace=out)
    short = tmp_path / "short.bin"
    short.write_bytes(out.getvalue()[:-7])
    with pytest.raises(TraceError, match="cut short"):
        list(read_trace(short))
    short.write_bytes(b"something else entirely")
    with pytest.raises(TraceError, match="not a navloom trace"):
        list(read_trace(short))


def test_a_run_resets_no_plugin_and_the_next_one_makes_new_objects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[object] = []
    make = toys.Bystander.__init__

    def kept(self: toys.Bystander, params: Any, context: Any) -> None:
        made.append(self)
        make(self, params, context)

    def refused(self: object) -> None:
        raise AssertionError("reset in a run")

    monkeypatch.setattr(toys.Bystander, "__init__", kept)
    monkeypatch.setattr(Role, "reset", refused)
    swap = '[[event]]\nat = {at}\ndo = "swap"\nrole = "avoider"\nname = "{name}"\n'
    events = swap.format(at=1.0, name="slow") + swap.format(at=2.0, name="toy_bystander")
    events += '[[event]]\nat = 3.0\ndo = "goal"\nx = 1.0\ny = 0.0\n'
    for run in (1, 2):
        log = drive(tmp_path, more=ALTERNATIVE.format(shadow="false") + events).log
        assert log.swaps == 2 and not log.faults and len(log.results) == 2
        assert len({id(one) for one in made}) == 2 * run  # the active one and the alternative


def test_roll_outs_are_published_with_diagnostics(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = np.zeros((1, 2, 2), np.float32)
    shown = Rollouts(line, np.zeros(1), line[0], ("goal",), np.ones(1))
    monkeypatch.setattr(toys.Bystander, "rollouts", lambda self: shown)
    _, entries = traced(tmp_path)
    ticks = {
        port: {e.tick for e in entries if (e.role, e.port) == ("avoider", port)} for port in ("status", "rollouts")
    }
    assert ticks["rollouts"] == ticks["status"] != set()


def test_an_avoider_without_roll_outs_publishes_none(tmp_path: Path) -> None:
    _, entries = traced(tmp_path)
    assert "rollouts" not in {e.port for e in entries}


def test_an_instance_that_was_active_steps_on_after_a_swap(tmp_path: Path) -> None:
    swap = '[[event]]\nat = 2.0\ndo = "swap"\nrole = "avoider"\nname = "slow"\n'
    looker = Everything()
    drive(tmp_path, more=ALTERNATIVE.format(shadow="false") + swap, observers=[looker])
    ticks = {name: [step.tick for step in looker.steps if step.instance == name] for name in ("toy_bystander", "slow")}
    assert ticks["toy_bystander"][-1] == ticks["slow"][-1] > 80 and ticks["slow"][0] == 40
