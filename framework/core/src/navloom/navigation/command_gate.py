"""The command gate: the last decision before the wheels. Pure: time and messages are handed in.

An ordinary stop (`Stop.is_ramp`) is a ramp: the speed falls by the robot's limits along the curvature of the last
command, and the collision monitor checks each step of it. Any other stop is a step to zero: contact, silence of the
platform or a sensor, a stale, missing or outdated command of the source that drives, a missing node, and the end of the
gate's own process. The monitor may order zero at any time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from navloom.messages import GateStatus, Point2D, StopReason, Twist2D
from navloom.navigation.braking import braked
from navloom.navigation.collision_monitor import CollisionMonitor, Verdict
from navloom.roles import RobotSpec

__all__ = ["STOPPED", "CommandGate", "GateLimits", "Offer", "Sensed"]

STOPPED = Twist2D(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class GateLimits:
    """Limits of commands, and the deadlines after which the robot must stop.

    Attributes:
        robot: Its limits of speed and acceleration.
        period: Control tick, s.
        stop_deadline_ns: Largest age of the Platform output that a command derives from, against the newest one.
        sensor_timeout_ns: Longest silence of a required sensor.
    """

    robot: RobotSpec
    period: float
    stop_deadline_ns: int
    sensor_timeout_ns: int


class Offer(NamedTuple):
    """A command of one source: instance, velocity, the Platform stamp it derives from, and its selection epoch."""

    instance: str
    twist: Twist2D
    cause_ns: int
    epoch: int


class Sensed(NamedTuple):
    """What the gate knows of the robot.

    Attributes:
        platform_ns: Newest stamp of the platform; live, what its clock shows now.
        touching: The robot touches something.
        sensors_ns: Newest stamp of each required sensor.
        is_silent: No message from the platform for as long as the stop deadline.
        gone: Why a required node does not do its part; None for none. An operator may drive without it.
        waiting: A node that does not step yet, and the stream it waits for; empty for none.
        late: The goal node, if its last step is too old; otherwise empty.
    """

    platform_ns: int
    touching: bool
    sensors_ns: Mapping[str, int]
    is_silent: bool = False
    gone: StopReason | None = None
    waiting: str = ""
    late: str = ""


class CommandGate:
    """Decides which source drives: stop > operator > recovery > avoider when handed over > controller.

    Args:
        limits: Limits of the robot.
        monitor: Checks each command for collisions before it passes; None for no check.

    Attributes:
        enters_unseen: An operator who drives may enter space that no sensor has seen.
        speed_limit: Largest speed of all sources but the operator, m/s; 0 for none beside those of the robot.
    """

    def __init__(self, limits: GateLimits, monitor: CollisionMonitor | None = None) -> None:
        self.limits = limits
        self.monitor = monitor
        self.speed, self.side, self.turn = 0.0, 0.0, 0.0
        self.enters_unseen = False
        self.speed_limit = 0.0
        self._slides = limits.robot.drive == "holonomic"
        self._driver = "none"
        self._ramp: StopReason | None = None
        self._operator_stop = False
        self._contact = False
        self._turns = False
        self._last: tuple[tuple[Any, ...], GateStatus] | None = None

    def request(self, do: str) -> None:
        """Take a request. `stop` and contacts latch until `resume`, `enter_unseen` until the next request."""
        # Any other request ends it: entering unseen space must be asked for again each time.
        self.enters_unseen = do == "enter_unseen"
        if do not in ("stop", "resume"):
            return
        self._operator_stop = do == "stop"
        # Only a resume forgives a contact; a second `stop` must not.
        if do == "resume":
            self._contact = False

    def fault(self, sensed: Sensed) -> StopReason | None:
        """Why no source is allowed to drive; None if one is."""
        hindrance = self._hindrance(sensed)
        # The hindrance is computed in either case, because it latches contacts.
        return StopReason("operator") if self._operator_stop else hindrance

    def _hindrance(self, sensed: Sensed) -> StopReason | None:
        """Contact, or a sensor whose last scan is older than `gate.sensor_timeout`; both forbid a ramp too."""
        # Latched here and not by the goal: a stop for contact must not wait for the goal's turn in the next tick.
        self._contact = self._contact or sensed.touching
        if self._contact:
            return StopReason("contact")
        if sensed.is_silent:
            return StopReason("silent_platform")
        # Against the platform's stamps, not a clock: hosts need no common time, and a paused simulation is not silent.
        for name, stamp in sensed.sensors_ns.items():
            if sensed.platform_ns - stamp > self.limits.sensor_timeout_ns:
                return StopReason("silent_sensor", name)
        return None

    @property
    def is_moving(self) -> bool:
        """Whether the last command was not zero."""
        return self.speed != 0.0 or self.side != 0.0 or self.turn != 0.0

    @property
    def _pace(self) -> float:
        """Speed of the last command, m/s: negative backwards, but not if there is a part to the side."""
        return math.hypot(self.speed, self.side) if self.side else self.speed

    def _passed(self, verdict: Verdict) -> None:
        """Remember what was passed, not what was asked for: the next limits start from what the wheels got."""
        self.speed, self.side, self.turn = verdict.twist.vx, verdict.twist.vy, verdict.twist.wz

    def ramps(self, reason: StopReason | None, sensed: Sensed) -> bool:
        """Whether a stop for this reason, from `choose`, is a ramp."""
        return (
            self.is_moving
            and reason is not None
            and reason.stop.is_ramp
            and not self._hindrance(sensed)
            # A ramp follows the last command of the driver; if that node is gone, nothing vouches for its command.
            and not self._absent(self._driver, sensed)
        )

    @property
    def has_contact(self) -> bool:
        """Whether a contact is latched."""
        return self._contact

    def latch_contact(self) -> None:
        """Latch a contact that was seen between two steps."""
        self._contact = True

    @property
    def is_latched(self) -> bool:
        """Whether the gate stays stopped until `resume`."""
        return self._operator_stop or self._contact

    def latch(self, reason: StopReason | None) -> None:
        """Take over the stop of an earlier gate. A stop for a silent operator becomes an operator's stop."""
        # The operator cannot know that the gate was restarted: nothing drives until a `resume`.
        latched = "" if reason is None else reason.stop.restores
        self._operator_stop, self._contact = latched == "operator", latched == "contact"

    def choose(
        self, sensed: Sensed, offers: Mapping[str, Offer | None], engaged: bool, epoch: int
    ) -> tuple[str, Offer | None, StopReason | None]:
        """The source that drives, its command, and why it is refused; None if it is not. See `decide`."""
        source, offer = "none", None
        # The order is the priority.
        for role in ("operator", "recovery", "avoider" if engaged else "controller"):
            found = offers.get(role)
            if found is not None:
                source, offer = role, found
                break
        fault = self.fault(sensed)
        reason = fault or self._refusal(source, offer, offers, sensed, epoch)
        is_braking = self._ramp and self.is_moving and not fault and not self._absent(self._driver, sensed)
        if reason and is_braking and not reason.stop.is_ramp:
            reason = self._ramp  # a source that does not drive yet, as at the start of the next goal, is no fault
        return source, offer, reason

    def decide(
        self, sensed: Sensed, offers: Mapping[str, Offer | None], engaged: bool, epoch: int, pending: Sequence[str]
    ) -> tuple[Twist2D, int, GateStatus]:
        """The command for this tick, the Platform stamp it derives from, and the status.

        Args:
            sensed: State of the platform.
            offers: By role, the commands of operator, recovery, avoider and controller.
            engaged: The avoider drives instead of the controller.
            epoch: Epoch of the current selection; offers of an older one are refused.
            pending: Pending swaps.
        """
        source, offer, reason = self.choose(sensed, offers, engaged, epoch)
        if reason is not None and self.ramps(reason, sensed):
            return self._slow_down(reason, sensed, pending)
        # A step to zero, not a ramp: the command that a ramp would continue is stale, missing or wrong.
        if reason is not None or offer is None:
            return STOPPED, sensed.platform_ns, self.stop(reason, pending)
        self._driver, self._ramp = source, None
        pace, monitor = self._pace, self.monitor
        limited = self._limit(offer.twist if source == "operator" else self._slowed(offer.twist))
        # Remembered for the status: a robot that turns needs a recovery other than one that meets an obstacle.
        self._turns = limited.vx == 0.0 and limited.vy == 0.0 and limited.wz != 0.0
        if monitor is None:
            return limited, offer.cause_ns, self._free(source, offer.instance, pending)
        # Only the operator can judge space that no sensor sees; a goal that runs meanwhile gains no rights.
        monitor.ignores_unseen = self.enters_unseen and source == "operator"
        verdict = monitor.judge(limited, pace, sensed.platform_ns * 1e-9)
        self._passed(verdict)
        return verdict.twist, offer.cause_ns, self._status(source, offer.instance, verdict, pending)

    def look_again(self, status: GateStatus, time: float) -> tuple[Twist2D, GateStatus] | None:
        """Slow down or stop for scans after the last command; None if it is still free. `time` is run time, s."""
        if self.monitor is None or not self.is_moving:
            return None
        verdict = self.monitor.judge(Twist2D(self.speed, self.side, self.turn), self._pace, time)
        # A scan cannot raise the speed between two ticks: that needs a command.
        if not verdict.kind:
            return None
        self._passed(verdict)
        if self._ramp:
            return verdict.twist, self._braking(verdict, status.pending)
        return verdict.twist, self._status(status.source, status.instance, verdict, status.pending)

    def announce(self, reason: StopReason, pending: Sequence[str]) -> GateStatus:
        """The status of a ramp that begins with the next tick."""
        self._ramp = reason
        return GateStatus("none", "", False, self.is_latched, reason, tuple(pending))

    def _slow_down(self, reason: StopReason, sensed: Sensed, pending: Sequence[str]) -> tuple[Twist2D, int, GateStatus]:
        """One step of the ramp of an ordinary stop: as `decide`, but no source drives."""
        self._ramp, pace = reason, self._pace
        slower = braked(pace, self.limits.robot.max_deceleration * self.limits.period)
        # The turn rate falls in proportion, so that the ramp follows the curvature that the monitor found free.
        ahead, side = (self.speed * slower / pace, self.side * slower / pace) if self.side else (slower, 0.0)
        verdict = Verdict(self._limit(Twist2D(ahead, side, self.turn * slower / pace if pace else 0.0)))
        if self.monitor is not None:
            verdict = self.monitor.judge(verdict.twist, pace, sensed.platform_ns * 1e-9)
            self._passed(verdict)
        return verdict.twist, sensed.platform_ns, self._braking(verdict, pending)

    def _braking(self, verdict: Verdict, pending: Sequence[str]) -> GateStatus:
        """The status during a ramp, with the monitor's verdict."""
        limited = self._status("none", "", verdict, pending)
        return replace(limited, stopped=not self.is_moving, latched=self.is_latched, why=self._ramp)

    def _status(self, source: Any, instance: str, verdict: Verdict, pending: Sequence[str]) -> GateStatus:
        """The status of a driving source with the monitor's verdict, rounded so that noise alone does not change it."""
        is_overridden = self.monitor is not None and self.monitor.ignores_unseen
        if not verdict.kind and verdict.share == 1.0 and not is_overridden:
            return self._free(source, instance, pending)
        place, distance, is_stopped = verdict.place, verdict.distance, verdict.is_stopped
        # A status is published only when it changes, and raw shares change in every tick.
        share, limit = round(verdict.share, 1), verdict.kind or ("overridden" if is_overridden else "")
        where = None if place is None else (round(place.x, 1), round(place.y, 1))
        gap = None if distance is None else round(distance, 2)
        kind = "" if not is_stopped else "no_room" if self._turns and limit == "obstacle" else "obstacle"
        return self._said((source, instance, kind, tuple(pending), share, limit, where, gap))

    def _free(self, source: str, instance: str, pending: Sequence[str]) -> GateStatus:
        """The status of a driving source whose command is not limited."""
        return self._said((source, instance, "", tuple(pending), 1.0, "", None, None))

    def _said(self, key: tuple[Any, ...]) -> GateStatus:
        """The status of (source, instance, kind of its stop, pending, share, limit, place, distance)."""
        if self._last is None or self._last[0] != key:  # in most ticks it is the same as before
            source, instance, kind, pending, share, limit, where, gap = key
            point, why = None if where is None else Point2D(*where), StopReason(kind) if kind else None
            status = GateStatus(source, instance, bool(kind), False, why, pending, share, limit, point, gap)
            self._last = key, status
        return self._last[1]

    def stop(self, reason: StopReason | None, pending: Sequence[str]) -> GateStatus:
        """Forget the speed, and return a status in which no source drives."""
        self.speed, self.side, self.turn, self._ramp = 0.0, 0.0, 0.0, None
        return GateStatus("none", "", True, self.is_latched, reason, tuple(pending))

    def _refusal(
        self, source: str, offer: Offer | None, offers: Mapping[str, Offer | None], sensed: Sensed, epoch: int
    ) -> StopReason | None:
        """Why an offer is refused: nothing to drive, a stale or missing part of the chain, or an older selection."""
        if offer is None:
            absent = self._absent(self._driver, sensed) if self.is_moving else None
            return absent or _waits(sensed) or StopReason("no_trajectory")
        # An operator may drive a robot home whose planner or mapper has died.
        if sensed.gone and source != "operator":
            return sensed.gone
        # Both, whichever of them drives: a silent avoider could no longer take over, and its hand-over would be stale.
        required = ("controller", "avoider") if source in ("controller", "avoider") else (source,)
        for role in required:
            part = offers.get(role)
            if part is None:
                return _waits(sensed) or StopReason("silent", role)
            # `abs`: a command that claims to derive from the future is refused like a stale one.
            if abs(sensed.platform_ns - part.cause_ns) > self.limits.stop_deadline_ns:
                return _stale(role, part.instance)
        if sensed.late and source != "operator":
            return StopReason("goal_late")
        # A command of the previous selection may still be on its way after a swap; operators are never swapped.
        if offer.epoch < epoch and source != "operator":
            return StopReason("old_selection", f"{source} {offer.instance}")
        return None

    def _absent(self, driver: str, sensed: Sensed) -> StopReason | None:
        """A missing node or a late goal node as a reason; None for neither, or if an operator drives."""
        # An operator drives without the nodes of autonomy, so that their absence ends no ramp either.
        if driver == "operator":
            return None
        return sensed.gone or (StopReason("goal_late") if sensed.late else None)

    def _slowed(self, twist: Twist2D) -> Twist2D:
        """The velocity within `speed_limit`. Its curvature stays, so that the robot drives the same way, slower."""
        pace = math.hypot(twist.vx, twist.vy) if self._slides else abs(twist.vx)
        if not 0.0 < self.speed_limit < pace:
            return twist
        share = self.speed_limit / pace
        return Twist2D(twist.vx * share, twist.vy * share, twist.wz * share)

    def _limit(self, twist: Twist2D) -> Twist2D:
        """The velocity within the robot's limits of speed and acceleration, which becomes the last command."""
        robot, period = self.limits.robot, self.limits.period
        wz = twist.wz
        if self._slides and (twist.vy or self.side):
            speed, side = self._planar(twist)
        else:
            # Limited, not refused: a high gain exceeds a limit now and then. Wrong units are reported by the door.
            wanted, side = min(max(twist.vx, -robot.max_linear), robot.max_linear), 0.0
            # Through zero counts as braking: only the part that leads away from zero is acceleration.
            speeding_up = abs(wanted) > abs(self.speed) and wanted * self.speed >= 0.0
            step = (robot.max_acceleration if speeding_up else robot.max_deceleration) * period
            speed = min(max(wanted, self.speed - step), self.speed + step)
        if robot.turn_radius > 0.0:
            wz = self._steered(twist, speed)
        turn = min(max(wz, -robot.max_angular), robot.max_angular)
        if robot.max_angular_acceleration < math.inf:
            step = robot.max_angular_acceleration * period
            turn = min(max(turn, self.turn - step), self.turn + step)
        self.speed, self.side, self.turn = speed, side, turn
        return Twist2D(speed, side, turn)

    def _planar(self, twist: Twist2D) -> tuple[float, float]:
        """Speed ahead and to the left, m/s, of a holonomic robot: the limits hold for their vector."""
        robot, period = self.limits.robot, self.limits.period
        asked, now = math.hypot(twist.vx, twist.vy), math.hypot(self.speed, self.side)
        share = min(1.0, robot.max_linear / asked) if asked else 0.0
        ahead, side = share * twist.vx, share * twist.vy
        speeding_up = share * asked > now and ahead * self.speed + side * self.side >= 0.0
        step = (robot.max_acceleration if speeding_up else robot.max_deceleration) * period
        change = math.hypot(ahead - self.speed, side - self.side)
        part = min(1.0, step / change) if change else 1.0
        return self.speed + part * (ahead - self.speed), self.side + part * (side - self.side)

    def _steered(self, twist: Twist2D, speed: float) -> float:
        """Turn rate, rad/s, of a robot that cannot turn in place, at a speed, m/s: the curvature asked for, if it can.

        A twist without a speed keeps the curvature of the last command: steered wheels turn nothing that stands.
        """
        if twist.vx:
            curvature = twist.wz / twist.vx
        else:
            curvature = self.turn / self.speed if self.speed else 0.0
        most = 1.0 / self.limits.robot.turn_radius
        return speed * min(max(curvature, -most), most)


def _waits(sensed: Sensed) -> StopReason | None:
    """The reason of a stop for a node that waits for its first inputs; None if none does."""
    if not sensed.waiting:
        return None
    who, _, of = sensed.waiting.partition(" for ")
    return StopReason("waits", who, of)


def _stale(role: str, instance: str) -> StopReason:
    """The reason of a stop for a command from old data."""
    return StopReason("stale_operator", instance) if role == "operator" else StopReason("stale", f"{role} {instance}")
