"""The ramp of an ordinary stop: its steps, what the monitor makes of them, its status, and what ends it."""

from __future__ import annotations

import math
from typing import Any

import pytest
from judged_gate import FREE, HALT, LIMITS, NOW, WALL, Judge, decide, judged, offer, sensed
from limits import with_robot
from navloom.messages import GateStatus, Point2D, StopReason
from navloom.navigation.command_gate import CommandGate, GateLimits

GONE = StopReason("gone", "planner main")


def moving(speed: float, turn: float, limits: GateLimits = LIMITS, role: str = "operator") -> tuple[CommandGate, Judge]:
    """A gate with a monitor, whose last command of a role was this one."""
    gate, judge = judged(limits=with_robot(limits, max_acceleration=1e3, max_angular_acceleration=math.inf))
    assert decide(gate, {role: offer(speed, turn), "controller": offer(speed, turn), "avoider": offer()})[0].wz == turn
    gate.limits = limits
    judge.asked.clear()
    return gate, judge


def test_a_step_of_a_ramp_is_judged_with_the_speed_before_it_and_the_platforms_time() -> None:
    """1.1 m/s² · 0.05 s less than 0.33 m/s is 5/6 of it; 0.15 rad/s becomes 0.125 rad/s, by less than 1.3 rad/s²."""
    gate, judge = moving(0.33, 0.15)
    twist, cause, _ = decide(gate, {}, sensed(platform_ns=NOW + 7))
    assert (twist.vx, twist.wz) == pytest.approx((0.275, 0.125)) and cause == NOW + 7
    assert judge.asked == [(twist, 0.33, pytest.approx((NOW + 7) * 1e-9, abs=1e-12), False)]


def test_a_ramp_that_turns_slower_than_its_curvature_keeps_to_the_turn_acceleration() -> None:
    """From 0.11 m/s and 0.6 rad/s: half the speed, but only 1.3 rad/s² · 0.05 s of the turn, the rest later."""
    gate, _ = moving(0.11, 0.6)
    turns = [decide(gate, {})[0] for _ in range(3)]
    assert [(twist.vx, twist.wz) for twist in turns] == [
        pytest.approx((0.055, 0.535)), pytest.approx((0.0, 0.47)), pytest.approx((0.0, 0.405)),
    ]  # fmt: skip


def test_a_ramp_goes_on_from_what_the_monitor_let_pass() -> None:
    """The wall leaves 0.21 m/s and 0.07 rad/s: the next step is 0.055 m/s slower, on the same radius of 3 m."""
    gate, judge = moving(0.33, 0.11)
    judge.verdict = WALL
    assert decide(gate, {})[0] == WALL.twist
    judge.verdict = None
    twist = decide(gate, {})[0]
    assert (twist.vx, twist.wz) == pytest.approx((0.155, 0.155 / 3.0))


def test_the_status_of_a_ramp_names_no_source_and_what_limits_it() -> None:
    gate, judge = moving(0.33, 0.11)
    judge.verdict = WALL
    status = gate.decide(sensed(waiting="planner main"), {}, False, 3, ["avoider other"])[2]
    waits, place = StopReason("waits", "planner main"), Point2D(0.4, -0.3)
    assert status == GateStatus("none", "", False, False, waits, ("avoider other",), 0.3, "obstacle", place, 0.13)
    again = gate.look_again(status, 1.02)
    assert again == (WALL.twist, status)
    judge.verdict = HALT
    halted = gate.look_again(status, 1.03)
    assert halted is not None and halted[1].stopped and halted[1].reason == "waits: planner main"
    assert (halted[1].source, halted[1].limit) == ("none", "unseen")


def test_a_ramp_is_announced_before_its_first_step() -> None:
    gate, _ = moving(0.33, 0.11)
    gate.request("stop")
    assert gate.announce(StopReason("operator"), ["avoider other"]) == GateStatus(
        "none", "", False, True, StopReason("operator"), ("avoider other",)
    )
    assert decide(gate, {"operator": offer(0.33)})[0].vx == pytest.approx(0.275)


@pytest.mark.parametrize(
    ("reason", "more", "role", "ramps"),
    [
        ("operator", {}, "controller", True),
        ("no_trajectory", {}, "controller", True),
        ("waits: planner main", {}, "controller", True),
        ("stale: controller a", {}, "controller", False),
        ("silent: controller", {}, "controller", False),
        ("", {}, "controller", False),
        ("operator", {"touching": True}, "controller", False),
        ("operator", {"is_silent": True}, "controller", False),
        ("operator", {"sensors_ns": {"laser": NOW - 500_000_001}}, "controller", False),
        ("operator", {"gone": GONE}, "controller", False),
        ("operator", {"late": "goal main"}, "controller", False),
        ("operator", {"gone": GONE}, "operator", True),  # an operator drives without a planner
        ("operator", {"late": "goal main"}, "operator", True),
    ],
)
def test_a_robot_ramps_down_for_an_ordinary_stop_without_a_fault(
    reason: str, more: dict[str, Any], role: str, ramps: bool
) -> None:
    why = StopReason.parse(reason)
    gate, _ = moving(0.33, 0.11, role=role)
    assert gate.ramps(why, sensed(**more)) is ramps
    assert not CommandGate(LIMITS).ramps(why, sensed(**more)), "a robot at rest has nothing to ramp down"


def test_a_robot_that_turns_on_the_spot_ramps_down_too() -> None:
    gate, _ = moving(0.0, 0.11)
    assert gate.is_moving and gate.ramps(StopReason("operator"), sensed())
    assert decide(gate, {})[0].wz == pytest.approx(0.045)


def test_an_offer_that_is_refused_during_a_ramp_leaves_its_reason_until_the_robot_stands() -> None:
    gate, _ = moving(0.06, 0.0, role="controller")
    late = {"controller": offer(age_ns=100_000_001), "avoider": offer()}
    assert gate.choose(sensed(), late, False, 3)[2] == StopReason("stale", "controller a"), "no ramp has begun"
    assert decide(gate, {})[2].reason == "no_trajectory"
    assert gate.choose(sensed(), late, False, 3)[2] == StopReason("no_trajectory")
    assert gate.choose(sensed(gone=GONE), late, False, 3)[2] == GONE
    gate.request("stop")
    assert gate.choose(sensed(), late, False, 3)[2] == StopReason("operator")
    gate.request("resume")
    decide(gate, {})
    assert not gate.is_moving and gate.choose(sensed(), late, False, 3)[2] == StopReason("stale", "controller a")


def test_a_robot_that_drives_again_has_no_ramp() -> None:
    gate, _ = moving(0.33, 0.0, role="controller")
    decide(gate, {})
    assert decide(gate, {"controller": offer(0.3), "avoider": offer()})[0].vx == pytest.approx(0.3)
    late = {"controller": offer(age_ns=100_000_001), "avoider": offer()}
    assert gate.choose(sensed(), late, False, 3)[2] == StopReason("stale", "controller a")


def test_without_a_monitor_a_ramp_ends_too() -> None:
    gate = CommandGate(FREE)
    decide(gate, {"operator": offer(-0.33, 0.11)})
    gate.limits = LIMITS
    twist = decide(gate, {})[0]
    assert (twist.vx, twist.wz) == pytest.approx((-0.275, 0.11 * 5 / 6)) and (gate.speed, gate.turn) == (
        twist.vx,
        twist.wz,
    )


def test_a_second_source_during_a_ramp_is_named_as_it_is() -> None:
    gate, _ = moving(0.33, 0.11, role="controller")
    reason = "rivals: controller main on host base (process 12) and on host copy (process 14)"
    twist, _, status = decide(gate, {}, sensed(gone=StopReason.parse(reason)))
    assert (twist.vx, status.stopped, status.reason) == (0.0, True, reason)
