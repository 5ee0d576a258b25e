"""The command gate in detail: limits tick by tick, refusals in their order, and what its status says."""

from __future__ import annotations

import math
from typing import Any

import pytest
from judged_gate import FREE, HALT, LIMITS, NOW, WALL, decide, judged, offer, sensed
from limits import with_robot
from navloom.messages import GateStatus, Point2D, StopReason, Twist2D
from navloom.navigation.collision_monitor import Verdict
from navloom.navigation.command_gate import STOPPED, CommandGate, Offer
from navloom.testing import robot


def drive(gate: CommandGate, vx: float, wz: float = 0.0) -> tuple[float, float]:
    """Let an operator drive for one tick."""
    twist = decide(gate, {"operator": offer(vx, wz)})[0]
    assert twist.vy == 0.0
    return twist.vx, twist.wz


# --- limits -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_speed_rises_by_the_acceleration_to_the_limit(side: float) -> None:
    """0.03 m/s a tick: 0.7 m/s after 24 of them."""
    gate = CommandGate(LIMITS)
    speeds = [drive(gate, side * 5.0)[0] for _ in range(26)]
    assert speeds == pytest.approx([side * min(0.7, 0.03 * k) for k in range(1, 27)])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("wanted", [0.0, 0.2, -0.4], ids=["stop", "slower", "back"])
def test_speed_falls_by_the_deceleration_and_reversing_brakes_with_it(side: float, wanted: float) -> None:
    """0.055 m/s a tick from 0.6 m/s: ten or eleven of them; beyond standstill it rises by 0.03 m/s a tick."""
    gate = CommandGate(LIMITS)
    gate.speed = side * 0.6
    speeds = [side * drive(gate, side * wanted)[0] for _ in range(11)]
    assert speeds == pytest.approx([max(wanted, 0.6 - 0.055 * k) for k in range(1, 12)])


def test_at_standstill_either_direction_begins_with_the_acceleration() -> None:
    assert drive(CommandGate(LIMITS), -0.5)[0] == pytest.approx(-0.03)
    assert drive(CommandGate(LIMITS), 0.5)[0] == pytest.approx(0.03)


def test_a_command_that_is_near_is_reached() -> None:
    gate = CommandGate(LIMITS)
    gate.speed, gate.turn = 0.4, -0.2
    assert drive(gate, 0.41, -0.23) == pytest.approx((0.41, -0.23))
    assert drive(gate, 0.37, -0.18) == pytest.approx((0.37, -0.18))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_turn_rate_rises_and_falls_by_the_turn_acceleration_to_the_limit(side: float) -> None:
    """0.065 rad/s a tick: 0.9 rad/s after 14 of them, and from there to -0.9 rad/s in 28."""
    gate = CommandGate(LIMITS)
    turns = [side * drive(gate, 0.0, side * 5.0)[1] for _ in range(16)]
    assert turns == pytest.approx([min(0.9, 0.065 * k) for k in range(1, 17)])
    turns = [side * drive(gate, 0.0, -side * 5.0)[1] for _ in range(30)]
    assert turns == pytest.approx([max(-0.9, 0.9 - 0.065 * k) for k in range(1, 31)])


def test_without_a_limit_of_the_turn_acceleration_any_turn_rate_begins_at_once() -> None:
    gate = CommandGate(with_robot(LIMITS, max_angular_acceleration=math.inf))
    assert [drive(gate, 0.0, wz)[1] for wz in (0.8, -3.0, 3.0)] == [0.8, -0.9, 0.9]
    assert robot().max_angular_acceleration == math.inf


def test_a_fault_stops_the_wheels_and_the_turn_at_once() -> None:
    gate = CommandGate(LIMITS)
    gate.speed, gate.turn = 0.4, 0.5
    twist, cause, status = decide(gate, {"operator": offer()}, sensed(touching=True))
    assert (twist.vx, twist.vy, twist.wz) == (0.0, 0.0, 0.0) and twist == STOPPED and cause == NOW
    assert status == GateStatus("none", "", True, True, StopReason("contact"), ())
    gate.request("resume")
    assert drive(gate, 5.0, 5.0) == pytest.approx((0.03, 0.065)), "it begins from standstill"


# --- order of sources and refusals ------------------------------------------------------------------------------------

ALL = {role: offer(name=role[0]) for role in ("operator", "recovery", "avoider", "controller")}


def source(offers: dict[str, Offer | None], engaged: bool = False, **more: Any) -> tuple[str, str]:
    status = decide(CommandGate(LIMITS), offers, sensed(**more), engaged)[2]
    return status.source, status.reason


def only(*roles: str) -> dict[str, Offer | None]:
    return {role: ALL[role] for role in roles}


def test_sources_drive_in_order() -> None:
    assert source(dict(ALL)) == ("operator", "")
    assert source(only("recovery", "avoider", "controller")) == ("recovery", "")
    assert source(only("avoider", "controller")) == ("controller", "")
    assert source(only("avoider", "controller"), engaged=True) == ("avoider", "")
    assert source({**only("avoider", "controller"), "operator": None, "recovery": None}) == ("controller", "")


def test_a_command_passes_with_the_stamp_that_it_derives_from() -> None:
    _, cause, status = decide(CommandGate(LIMITS), {"operator": offer(age_ns=70, name="desk")})
    assert cause == NOW - 70
    assert status == GateStatus("operator", "desk", False, False, None, (), 1.0, "", None, None)


@pytest.mark.parametrize(
    ("offers", "more", "reason"),
    [
        ({}, {}, "no_trajectory"),
        ({}, {"waiting": "mapper main for sonars"}, "waits: mapper main for sonars"),
        (only("controller"), {}, "silent: avoider"),
        (only("controller"), {"waiting": "avoider main"}, "waits: avoider main"),
        (only("avoider"), {}, "no_trajectory"),
        (only("avoider", "controller"), {"gone": StopReason("gone", "mapper main")}, "gone: mapper main"),
        (only("recovery"), {"gone": StopReason("gone", "mapper main")}, "gone: mapper main"),
        (only("operator"), {"gone": StopReason("gone", "mapper main")}, ""),
        (only("avoider", "controller"), {"late": "goal main"}, "stale: goal main"),
        (only("operator"), {"late": "goal main"}, ""),
        (only("recovery"), {}, ""),
        (only("operator"), {"is_silent": True}, "silent: platform"),
        (only("operator"), {"touching": True, "is_silent": True}, "contact"),
        ({}, {"is_silent": True}, "silent: platform"),
        (only("operator"), {"sensors_ns": {"a": NOW, "b": NOW - 500_000_001}}, "silent: sensor b"),
        (only("operator"), {"sensors_ns": {"a": NOW + 10**9, "b": NOW - 500_000_000}}, ""),
    ],
)
def test_reasons_of_a_stop(offers: dict[str, Offer | None], more: dict[str, Any], reason: str) -> None:
    assert source(offers, **more) == (next(iter(offers)) if offers and not reason else "none", reason) or (
        not reason and source(offers, **more)[1] == ""
    )


@pytest.mark.parametrize("role", ["operator", "recovery"])
@pytest.mark.parametrize(("age", "is_stale"), [(100_000_000, False), (100_000_001, True), (-100_000_000, False),
                                               (-100_000_001, True)])  # fmt: skip
def test_a_command_of_another_time_is_stale(role: str, age: int, is_stale: bool) -> None:
    assert source({role: offer(age_ns=age)})[1] == (f"stale: {role} a" if is_stale else "")


def test_both_parts_of_the_chain_must_be_fresh() -> None:
    for engaged in (False, True):
        for role in ("avoider", "controller"):
            offers = {**only("avoider", "controller"), role: offer(age_ns=100_000_001)}
            assert source(offers, engaged)[1] == f"stale: {role} a"


def test_an_older_selection_does_not_drive_but_an_operator_does() -> None:
    for role, is_refused in (("recovery", True), ("operator", False)):
        for epoch in (2, 3, 4):
            reason = decide(CommandGate(LIMITS), {role: offer(epoch=epoch)})[2].reason
            assert reason == (f"old_selection: {role} a" if is_refused and epoch == 2 else "")


# --- latches ----------------------------------------------------------------------------------------------------------


def test_stop_and_contact_latch_until_resume_and_no_other_request() -> None:
    gate = CommandGate(LIMITS)
    assert not gate.is_latched and not gate.has_contact
    gate.request("stop")
    assert gate.is_latched and not gate.has_contact
    gate.request("release")
    gate.request("enter_unseen")
    assert gate.is_latched
    gate.request("resume")
    assert not gate.is_latched
    gate.latch_contact()
    assert gate.is_latched and gate.has_contact
    gate.request("stop")
    assert gate.has_contact and gate.fault(sensed()) == StopReason("operator")
    gate.request("resume")
    assert not gate.is_latched and gate.fault(sensed()) is None


def test_entering_unseen_space_is_allowed_until_the_next_request() -> None:
    gate = CommandGate(LIMITS)
    assert not gate.enters_unseen
    gate.request("enter_unseen")
    assert gate.enters_unseen and not gate.is_latched
    gate.request("stop")
    assert not gate.enters_unseen


@pytest.mark.parametrize(
    ("reason", "fault", "has_contact"),
    [("operator", "operator", False), ("stale: operator desk", "operator", False), ("contact", "contact", True),
     ("silent: platform", "", False), ("stale: controller main", "", False)],
)  # fmt: skip
def test_a_later_gate_takes_over_a_latched_stop(reason: str, fault: str, has_contact: bool) -> None:
    gate = CommandGate(LIMITS)
    gate.latch(StopReason.parse(reason))
    assert gate.fault(sensed()) == StopReason.parse(fault) and gate.has_contact is has_contact


@pytest.mark.parametrize(
    ("reason", "rests"),
    [("no_trajectory", True), ("ending", True), ("waits: avoider main", True), ("stale: avoider main", False),
     ("operator", False)],
)  # fmt: skip
def test_a_robot_with_nothing_to_drive_is_at_rest(reason: str, rests: bool) -> None:
    status = GateStatus("none", "", True, False, StopReason.parse(reason), ())
    assert status.interrupts is not rests


@pytest.mark.parametrize(("more", "hides"), [({"is_silent": True}, True), ({"sensors_ns": {"b": 0}}, True),
                                             ({"touching": True}, False)])  # fmt: skip
def test_a_silent_robot_hides_that_the_operator_is_silent(more: dict[str, Any], hides: bool) -> None:
    fault = CommandGate(LIMITS).fault(sensed(**more))
    assert fault is not None and fault.stop.hides is hides


# --- with a monitor ---------------------------------------------------------------------------------------------------


def test_the_monitor_judges_the_limited_command_the_speed_before_it_and_the_platforms_time() -> None:
    gate, judge = judged(limits=LIMITS)
    gate.speed, gate.turn = 0.4, 0.1
    twist = decide(gate, {"operator": offer(0.7, -0.9)}, sensed(platform_ns=NOW + 7))[0]
    assert twist.vx == pytest.approx(0.43) and twist.wz == pytest.approx(0.1 - 0.065)
    assert judge.asked == [(twist, 0.4, pytest.approx((NOW + 7) * 1e-9, abs=1e-12), False)]


def test_what_the_monitor_lets_pass_is_driven_and_the_next_command_begins_there() -> None:
    gate, judge = judged(WALL, LIMITS)
    gate.speed = 0.4
    assert decide(gate, {"operator": offer(0.7)})[0] == WALL.twist
    judge.verdict = None
    assert drive(gate, 0.7, 0.9) == pytest.approx((0.24, 0.135))


def test_the_status_says_what_limits_a_command_in_round_numbers() -> None:
    gate, judge = judged(WALL)
    status = decide(gate, {"recovery": offer(name="back")})[2]
    assert status == GateStatus("recovery", "back", False, False, None, (), 0.3, "obstacle", Point2D(0.4, -0.3), 0.13)
    judge.verdict = WALL._replace(share=0.28, distance=0.133)
    assert decide(gate, {"recovery": offer(name="back")})[2] is status, "what does not show does not change it"
    judge.verdict = WALL._replace(share=0.24)
    assert decide(gate, {"recovery": offer(name="back")})[2].share == 0.2


def test_a_robot_that_the_monitor_stops_has_an_obstacle_in_its_way() -> None:
    status = decide(judged(HALT)[0], {"operator": offer(name="desk")})[2]
    why, place = StopReason("obstacle"), Point2D(0.4, 0.0)
    assert status == GateStatus("operator", "desk", True, False, why, (), 0.0, "unseen", place, 0.4)


def test_a_reduced_command_says_so_though_nothing_is_named() -> None:
    status = decide(judged(Verdict(Twist2D(0.1, 0.0, 0.0), 0.52))[0], {"operator": offer()})[2]
    assert (status.share, status.limit, status.place, status.distance) == (0.5, "", None, None)


def test_what_limits_a_command_is_named_though_all_of_it_passes() -> None:
    status = decide(judged(WALL._replace(share=1.0))[0], {"operator": offer()})[2]
    assert (status.share, status.limit, status.distance) == (1.0, "obstacle", 0.13)


@pytest.mark.parametrize("role", ["operator", "recovery"])
@pytest.mark.parametrize("enters", [True, False])
def test_only_an_operator_overrides_unseen_space(role: str, enters: bool) -> None:
    gate, judge = judged()
    judge.ignores_unseen = True
    gate.enters_unseen = enters
    status = decide(gate, {role: offer()})[2]
    overrides = enters and role == "operator"
    assert judge.asked[0][3] is overrides and status.limit == ("overridden" if overrides else "")
    judge.verdict = WALL
    assert decide(gate, {role: offer()})[2].limit == "obstacle"


def test_a_status_is_made_again_when_something_of_it_changes() -> None:
    gate, _ = judged()
    first = decide(gate, {"operator": offer()})[2]
    assert decide(gate, {"operator": offer()})[2] is first
    seen = sensed()
    pending = gate.decide(seen, {"operator": offer()}, False, 3, ["avoider other"])[2]
    assert pending.pending == ("avoider other",)
    plain = CommandGate(FREE)
    assert plain.decide(seen, {"operator": offer()}, False, 3, ["avoider other"])[2].pending == ("avoider other",)
    assert plain.decide(seen, {}, False, 3, ["avoider other"])[2].pending == ("avoider other",)
    assert decide(gate, {"operator": offer(name="desk")})[2].instance == "desk"


# --- between two ticks ------------------------------------------------------------------------------------------------


def test_a_command_is_looked_at_again_with_what_the_robot_drives() -> None:
    gate, judge = judged()
    status = gate.decide(sensed(), {"operator": offer(0.3, -0.2, name="desk")}, False, 3, ["avoider other"])[2]
    assert gate.look_again(status, 1.02) is None
    assert judge.asked[1] == (Twist2D(0.3, 0.0, -0.2), 0.3, 1.02, False)
    judge.verdict = WALL
    looked = gate.look_again(status, 1.03)
    assert looked is not None and looked[0] == WALL.twist
    assert (looked[1].source, looked[1].instance, looked[1].limit) == ("operator", "desk", "obstacle")
    assert looked[1].pending == ("avoider other",)
    judge.verdict = None
    assert gate.look_again(status, 1.04) is None
    assert judge.asked[-1][:2] == (WALL.twist, 0.21)


def test_a_stopped_robot_and_one_without_a_monitor_are_not_looked_at_again() -> None:
    gate, judge = judged(HALT)
    status = decide(gate, {"operator": offer()})[2]
    assert gate.look_again(status, 1.02) is None and len(judge.asked) == 1
    plain = CommandGate(FREE)
    assert plain.look_again(decide(plain, {"operator": offer()})[2], 1.02) is None
