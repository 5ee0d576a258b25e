"""The command gate: order of the sources, limits, and every reason to stop."""

from __future__ import annotations

import numpy as np
import pytest
from limits import with_robot
from navloom.messages import Odometry, Point2D, Pose2D, RangeScan, StopReason, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.navigation.command_gate import CommandGate, GateLimits, Offer, Sensed
from navloom.testing import robot

LIMITS = GateLimits(
    robot(max_linear=0.5, max_angular=0.4, max_acceleration=0.5, max_deceleration=1.0), period=0.05,
    stop_deadline_ns=100_000_000, sensor_timeout_ns=500_000_000,
)  # fmt: skip
NOW = 1_000_000_000


def offer(vx: float, wz: float = 0.0, cause_ns: int = NOW, epoch: int = 0, name: str = "a") -> Offer:
    return Offer(name, Twist2D(vx, 0.0, wz), cause_ns, epoch)


def decide(
    gate: CommandGate, offers: dict[str, Offer | None], engaged: bool = False, **sensed: object
) -> tuple[float, str, str]:
    seen = Sensed(NOW, bool(sensed.get("touching")), sensed.get("sensors", {}))  # type: ignore[arg-type]
    twist, _, status = gate.decide(seen, offers, engaged, int(sensed.get("epoch", 0)), ())  # type: ignore[call-overload]
    return twist.vx, status.source, status.reason


BOTH = {"controller": offer(0.02), "avoider": offer(0.01)}


def test_the_controller_drives_until_the_hand_over_to_the_avoider() -> None:
    assert decide(CommandGate(LIMITS), BOTH) == (0.02, "controller", "")
    assert decide(CommandGate(LIMITS), BOTH, engaged=True) == (0.01, "avoider", "")


def test_recovery_goes_before_both_and_the_operator_before_recovery() -> None:
    offers = {**BOTH, "recovery": offer(-0.01)}
    assert decide(CommandGate(LIMITS), offers) == (-0.01, "recovery", "")
    assert decide(CommandGate(LIMITS), {**offers, "operator": offer(0.025)}) == (0.025, "operator", "")


def test_without_a_command_the_reason_is_no_trajectory() -> None:
    assert decide(CommandGate(LIMITS), {}) == (0.0, "none", "no_trajectory")


def test_a_command_is_stale_beyond_the_deadline_and_not_at_it() -> None:
    old = {"controller": offer(0.02, cause_ns=NOW - 100_000_000), "avoider": offer(0.0)}
    assert decide(CommandGate(LIMITS), old)[2] == ""
    old["controller"] = offer(0.02, cause_ns=NOW - 100_000_001)
    assert decide(CommandGate(LIMITS), old) == (0.0, "none", "stale: controller a")


def test_a_stale_avoider_stops_the_robot_though_the_controller_drives() -> None:
    offers = {"controller": offer(0.02), "avoider": offer(0.0, cause_ns=0)}
    assert decide(CommandGate(LIMITS), offers)[2] == "stale: avoider a"


def test_a_command_of_an_older_selection_is_refused() -> None:
    assert decide(CommandGate(LIMITS), BOTH, epoch=1)[2] == "old_selection: controller a"


def test_a_silent_sensor_stops_the_robot() -> None:
    assert decide(CommandGate(LIMITS), BOTH, sensors={"sonars": NOW - 500_000_001})[2] == "silent: sensor sonars"
    assert decide(CommandGate(LIMITS), BOTH, sensors={"sonars": NOW - 500_000_000})[2] == ""


def test_an_operators_stop_latches_until_resume() -> None:
    gate = CommandGate(LIMITS)
    gate.request("stop")
    assert decide(gate, BOTH)[2] == "operator" and decide(gate, BOTH)[2] == "operator"
    gate.request("resume")
    assert decide(gate, BOTH)[1] == "controller"


def test_contact_latches_until_resume() -> None:
    gate = CommandGate(LIMITS)
    assert decide(gate, BOTH, touching=True)[2] == "contact"
    assert decide(gate, BOTH)[2] == "contact"
    gate.request("resume")
    assert decide(gate, BOTH)[1] == "controller"


def test_speed_rises_by_the_acceleration_and_falls_by_the_deceleration() -> None:
    gate = CommandGate(LIMITS)
    fast = {"controller": offer(9.0), "avoider": offer(0.0)}
    speeds = [decide(gate, fast)[0] for _ in range(22)]
    assert speeds[:3] == pytest.approx([0.025, 0.05, 0.075])
    assert speeds[-1] == 0.5
    assert decide(gate, {"controller": offer(0.0), "avoider": offer(0.0)})[0] == pytest.approx(0.45)


def test_a_speed_limit_slows_all_but_the_operator_along_their_curvature() -> None:
    """From 0.4 m/s and 0.2 rad/s to a quarter of both."""
    gate = driving_at(0.4, 0.2, max_deceleration=100.0)
    gate.speed_limit = 0.1
    for role in ("controller", "avoider", "recovery"):
        offers = {**BOTH, role: offer(0.4, 0.2)}
        assert ramp(gate, offers, 1, engaged=role == "avoider") == [(pytest.approx(0.1), pytest.approx(0.05))], role
    assert ramp(gate, {"recovery": offer(-0.4, 0.2)}, 1) == [(pytest.approx(-0.1), pytest.approx(0.05))]
    assert ramp(gate, {**BOTH, "operator": offer(0.4, 0.2)}, 1) == [(0.4, 0.2)]
    gate.speed_limit = 0.0
    assert ramp(gate, {**BOTH, "controller": offer(0.4, 0.2)}, 1) == [(0.4, 0.2)]


def test_reversing_brakes_first() -> None:
    gate = CommandGate(LIMITS)
    for _ in range(10):
        decide(gate, {"controller": offer(9.0), "avoider": offer(0.0)})
    assert decide(gate, {"controller": offer(-9.0), "avoider": offer(0.0)})[0] == pytest.approx(0.25 - 0.05)


def test_the_turn_rate_is_clipped() -> None:
    twist, _, _ = CommandGate(LIMITS).decide(
        Sensed(NOW, False, {}), {"controller": offer(0.0, wz=-3.0), "avoider": offer(0.0)}, False, 0, ()
    )
    assert twist.wz == -0.4


LATE = {"controller": offer(0.5, cause_ns=NOW - 100_000_001), "avoider": offer(0.0)}


def driving_at(
    speed: float, turn: float = 0.0, monitor: CollisionMonitor | None = None, **limits: float
) -> CommandGate:
    """A gate whose last command is this one, of the controller."""
    gate = CommandGate(with_robot(LIMITS, max_acceleration=100.0, **limits), monitor)
    for _ in range(3):
        decide(gate, {"controller": offer(speed, turn), "avoider": offer(0.0)})
    assert (gate.speed, gate.turn) == (speed, turn)
    return gate


def ramp(
    gate: CommandGate, offers: dict[str, Offer | None], ticks: int, engaged: bool = False
) -> list[tuple[float, float]]:
    twists = [gate.decide(Sensed(NOW, False, {}), offers, engaged, 0, ())[0] for _ in range(ticks)]
    return [(twist.vx, twist.wz) for twist in twists]


ORDINARY: dict[str, tuple[str, dict[str, Offer | None]]] = {
    "an operator's stop": ("stop", BOTH),
    "no trajectory": ("release", {}),
}


@pytest.mark.parametrize("stop", ORDINARY)
def test_an_ordinary_stop_brakes_by_the_deceleration_along_the_curvature(stop: str) -> None:
    """From 0.18 m/s and 0.09 rad/s (radius 2 m) by 1 m/s² · 0.05 s a tick."""
    do, offers = ORDINARY[stop]
    gate = driving_at(0.18, 0.09)
    gate.request(do)
    found = ramp(gate, offers, 5)
    assert found == [pytest.approx(one) for one in ((0.13, 0.065), (0.08, 0.04), (0.03, 0.015), (0, 0), (0, 0))]


def test_a_ramp_backwards_ends_at_zero() -> None:
    gate = CommandGate(with_robot(LIMITS, max_acceleration=100.0))
    decide(gate, {"recovery": offer(-0.08)})
    assert [vx for vx, _ in ramp(gate, {}, 3)] == pytest.approx([-0.03, 0.0, 0.0])


def test_a_turn_ends_by_the_turn_acceleration_at_a_stop() -> None:
    """2 rad/s² · 0.05 s: 0.1 rad/s a tick, although the forward speed is gone after one."""
    gate = driving_at(0.03, 0.25, max_angular_acceleration=2.0)
    assert ramp(gate, {}, 4) == [pytest.approx(one) for one in ((0.0, 0.15), (0.0, 0.05), (0.0, 0.0), (0.0, 0.0))]


def test_the_status_says_stopped_only_when_zero_is_commanded() -> None:
    gate = driving_at(0.08)
    gate.request("stop")
    found = [gate.decide(Sensed(NOW, False, {}), BOTH, False, 0, ())[2] for _ in range(2)]
    assert [(one.source, one.stopped, one.latched, one.reason) for one in found] == [
        ("none", False, True, "operator"), ("none", True, True, "operator"),
    ]  # fmt: skip


def test_a_ramp_derives_from_the_newest_platform_stamp() -> None:
    gate = driving_at(0.18)
    assert gate.decide(Sensed(NOW + 50_000_000, False, {}), {}, False, 0, ())[1] == NOW + 50_000_000


FAULTS: dict[str, Sensed] = {
    "contact": Sensed(NOW, True, {}),
    "silent: platform": Sensed(NOW, False, {}, is_silent=True),
    "silent: sensor laser": Sensed(NOW, False, {"laser": NOW - 500_000_001}),
    "gone: controller a": Sensed(NOW, False, {}, gone=StopReason("gone", "controller a")),
    "stale: goal main": Sensed(NOW, False, {}, late="goal main"),
}


@pytest.mark.parametrize("reason", FAULTS)
@pytest.mark.parametrize("stop", ORDINARY)
def test_a_fault_during_a_ramp_is_a_step_to_zero(stop: str, reason: str) -> None:
    do, offers = ORDINARY[stop]
    gate = driving_at(0.18)
    gate.request(do)
    assert ramp(gate, offers, 1) == [pytest.approx((0.13, 0.0))]
    twist, _, status = gate.decide(FAULTS[reason], offers, False, 0, ())
    assert (twist.vx, status.stopped) == (0.0, True)
    assert status.reason == ("operator" if do == "stop" else reason)


def test_a_stale_command_of_the_source_that_drives_is_a_step_to_zero() -> None:
    gate = driving_at(0.18)
    assert decide(gate, LATE) == (0.0, "none", "stale: controller a")


def test_a_drive_whose_first_command_is_not_there_yet_leaves_the_ramp_as_it_is() -> None:
    gate = driving_at(0.18)
    assert ramp(gate, {}, 1) == [pytest.approx((0.13, 0.0))]
    assert decide(gate, LATE) == (pytest.approx(0.08), "none", "no_trajectory")
    assert decide(gate, {"controller": offer(0.1), "avoider": offer(0.0)}) == (0.1, "controller", "")


def test_an_operator_whose_robot_lacks_a_node_is_released_by_a_ramp() -> None:
    gate = CommandGate(with_robot(LIMITS, max_acceleration=100.0))
    lacking = Sensed(NOW, False, {}, gone=StopReason("gone", "controller a"), late="goal main")
    gate.decide(lacking, {"operator": offer(0.18)}, False, 0, ())
    twist, _, status = gate.decide(lacking, {}, False, 0, ())
    assert (twist.vx, status.reason) == (pytest.approx(0.13), "no_trajectory")


def test_resume_during_a_ramp_drives_on_from_the_speed_it_has() -> None:
    gate = driving_at(0.18)
    gate.request("stop")
    ramp(gate, BOTH, 1)
    gate.request("resume")
    assert decide(gate, {"controller": offer(0.14), "avoider": offer(0.0)}) == (0.14, "controller", "")


def test_the_monitor_judges_each_step_of_a_ramp() -> None:
    """A laser echo 1 cm before the bumper: the monitor orders zero."""
    square = np.array([(0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3), (0.3, -0.3)])
    monitor = CollisionMonitor(MonitorLimits(robot(footprint=square), 0.05, 0.03))
    monitor.move(Odometry(NOW, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)))
    gate = driving_at(0.18, 0.0, monitor)
    bearings, one = np.linspace(-0.2, 0.2, 9), np.ones(9)
    for stamp in (NOW + 50_000_000, NOW + 100_000_000):
        monitor.move(Odometry(stamp, Pose2D(0.0, 0.0, 0.0), Twist2D(0.18, 0.0, 0.0)))
        scan = RangeScan(stamp, np.zeros((9, 2)), bearings, 0.0 * one, 0.0 * one, 0.31 / np.cos(bearings), 0.05, 4.0)
        assert monitor.look("laser", scan)
    twist, _, status = gate.decide(Sensed(NOW + 100_000_000, False, {}), {}, False, 0, ())
    assert (twist.vx, status.stopped, status.limit, status.reason) == (0.0, True, "obstacle", "no_trajectory")


@pytest.mark.parametrize("reason", ["operator", "contact", "stale: operator main"])
def test_a_restarted_gate_with_a_kept_stop_is_stopped_until_resume(reason: str) -> None:
    gate = CommandGate(LIMITS)
    gate.latch(StopReason.parse(reason))
    assert gate.is_latched and decide(gate, BOTH)[0] == 0.0
    gate.request("resume")
    assert not gate.is_latched and decide(gate, BOTH)[1] == "controller"


def test_a_restarted_gate_without_a_kept_stop_drives() -> None:
    gate = CommandGate(LIMITS)
    gate.latch(None)
    assert decide(gate, BOTH)[1] == "controller"


def test_only_an_operator_may_enter_unseen_space_and_only_until_release() -> None:
    """The space behind the robot was never seen: only the operator may enter it, until `release`."""
    square = np.array([(0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3), (0.3, -0.3)])
    monitor = CollisionMonitor(MonitorLimits(robot(footprint=square), 0.05, 0.03))
    monitor.move(Odometry(NOW, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)))
    gate = CommandGate(with_robot(LIMITS, max_acceleration=100.0), monitor)

    def backwards(role: str) -> tuple[str, float]:
        gate.stop(None, ())
        twist, _, status = gate.decide(Sensed(NOW, False, {}), {role: offer(-0.5)}, False, 0, ())
        return status.limit, twist.vx

    limit, slowed = backwards("operator")
    assert limit == "unseen" and slowed > -0.5
    gate.request("enter_unseen")
    assert backwards("operator") == ("overridden", -0.5)
    assert backwards("recovery") == ("unseen", slowed)
    gate.request("release")
    assert backwards("operator") == ("unseen", slowed)


@pytest.mark.parametrize(("twist", "reason"), [((0.0, 0.5), "no room to turn"), ((0.5, 0.0), "obstacle")])
def test_a_turn_on_the_spot_that_the_monitor_stops_has_no_room(twist: tuple[float, float], reason: str) -> None:
    class Stopping:
        ignores_unseen = False

        def judge(self, twist: Twist2D, speed: float, time: float) -> Verdict:
            return Verdict(Twist2D(0.0, 0.0, 0.0), 0.0, "obstacle", Point2D(0.0, -0.3), 0.05)

    gate = CommandGate(LIMITS, Stopping())  # type: ignore[arg-type]
    assert decide(gate, {"controller": offer(*twist), "avoider": offer(*twist)})[2] == reason
