"""The command gate, the last node before the wheels. Pure: time and messages are passed in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from navloom.messages import GateStatus, Point2D, Twist2D
from navloom.navigation.monitor import CollisionMonitor, Verdict

__all__ = ["ENDING", "HIDING", "LEFT", "OBSTACLE", "STOPPED", "WAITING", "CommandGate", "GateLimits", "Offer", "Sensed",
           "is_at_rest"]  # fmt: skip

STOPPED = Twist2D(0.0, 0.0, 0.0)
OBSTACLE = "obstacle"
"""Reason of a stop because of what the sensors see ahead."""
ENDING = "ending"
"""Reason of the last stop of a gate that ends in order."""
LEFT = "stale: operator"
"""Begin of the reason while the commands of an operator who drove are missing: no other source drives until `resume`."""
WAITING = "waits: "
"""Begin of the reason while a node waits for the first message of an input."""
HIDING = ("silent: platform", "silent: sensor")
"""Begins of reasons that take precedence over a missing operator."""


def is_at_rest(reason: str) -> bool:
    """Whether this reason of a stop means that there is nothing to drive, not that something failed."""
    return reason in ("no_trajectory", ENDING) or reason.startswith(WAITING)


@dataclass(frozen=True)
class GateLimits:
    """Limits of the commands to the wheels, and when the robot must be stopped.

    Attributes:
        linear, angular: m/s and rad/s.
        acceleration, deceleration: m/s².
        turn_acceleration: rad/s², of speeding up and slowing down; infinite for none.
        period: Control tick, s.
        stop_deadline_ns: A command may derive from a Platform output this much older than the newest one.
        sensor_timeout_ns: A required sensor may be silent this long.
    """

    linear: float
    angular: float
    acceleration: float
    deceleration: float
    period: float
    stop_deadline_ns: int
    sensor_timeout_ns: int
    turn_acceleration: float = math.inf


class Offer(NamedTuple):
    """A command on offer: by whom, what, the Platform stamp it derives from, and the selection it was made under."""

    instance: str
    twist: Twist2D
    cause_ns: int
    epoch: int


class Sensed(NamedTuple):
    """State of the robot, as the gate knows it.

    Attributes:
        platform_ns: Newest stamp of the platform; live, extrapolated to now.
        touching: It touches something.
        sensors_ns: Newest stamp of each required sensor.
        is_silent: Nothing came from the platform for as long as the stop deadline.
        gone: Required node that is gone; empty if none is. An operator may drive without it.
        waiting: Node that does not step yet, and the stream that it waits for; empty if there is none.
    """

    platform_ns: int
    touching: bool
    sensors_ns: Mapping[str, int]
    is_silent: bool = False
    gone: str = ""
    waiting: str = ""


class CommandGate:
    """Chooses who drives: stop > operator > recovery > avoider when handed over > controller.

    Args:
        limits: Of the robot.
        monitor: Looks where the robot is going before a command passes; None for a gate that does not look.

    Attributes:
        enters_unseen: An operator who drives may enter space that no sensor saw.
    """

    def __init__(self, limits: GateLimits, monitor: CollisionMonitor | None = None) -> None:
        self.limits = limits
        self.monitor = monitor
        self.speed, self.turn = 0.0, 0.0
        self.enters_unseen = False
        self._operator_stop = False
        self._contact = False
        self._last: tuple[tuple[Any, ...], GateStatus] | None = None

    def request(self, do: str) -> None:
        """An operator's `stop` latches until `resume`, and so does a contact; `enter_unseen` holds until `release`."""
        self.enters_unseen = do == "enter_unseen"
        if do not in ("stop", "resume"):
            return
        self._operator_stop = do == "stop"
        if do == "resume":
            self._contact = False

    def fault(self, sensed: Sensed) -> str:
        """Why no source may drive; empty if one may."""
        self._contact = self._contact or sensed.touching
        if self._operator_stop:
            return "operator"
        if self._contact:
            return "contact"
        if sensed.is_silent:
            return "silent: platform"
        for name, stamp in sensed.sensors_ns.items():
            if sensed.platform_ns - stamp > self.limits.sensor_timeout_ns:
                return f"silent: sensor {name}"
        return ""

    @property
    def has_contact(self) -> bool:
        """A contact is latched."""
        return self._contact

    def latch_contact(self) -> None:
        """Take up a contact that was seen between two steps."""
        self._contact = True

    @property
    def is_latched(self) -> bool:
        """It stays stopped until `resume`."""
        return self._operator_stop or self._contact

    def latch(self, reason: str) -> None:
        """Take up the stop of a gate before this one. Of an operator who drove then nothing more is known."""
        self._operator_stop = reason == "operator" or reason.startswith(LEFT)
        self._contact = reason == "contact"

    def choose(
        self, sensed: Sensed, offers: Mapping[str, Offer | None], engaged: bool, epoch: int
    ) -> tuple[str, Offer | None, str]:
        """Source of the command, the command, and why it is refused; empty if it is not. See `decide`."""
        source, offer = "none", None
        for role in ("operator", "recovery", "avoider" if engaged else "controller"):
            found = offers.get(role)
            if found is not None:
                source, offer = role, found
                break
        reason = self.fault(sensed) or self._refusal(source, offer, offers, sensed, epoch)
        return source, offer, reason

    def decide(
        self, sensed: Sensed, offers: Mapping[str, Offer | None], engaged: bool, epoch: int, pending: Sequence[str]
    ) -> tuple[Twist2D, int, GateStatus]:
        """Command for this tick, the Platform stamp that it derives from, and who drives or why the robot is stopped.

        Args:
            sensed: State of the platform.
            offers: By role, what is on offer: operator, recovery, avoider and controller.
            engaged: The avoider drives instead of the controller.
            epoch: Selection in force; offers of an older one are refused.
            pending: Swaps that wait.
        """
        source, offer, reason = self.choose(sensed, offers, engaged, epoch)
        if reason or offer is None:
            return STOPPED, sensed.platform_ns, self.stop(reason, pending)
        speed, monitor = self.speed, self.monitor
        limited = self._limit(offer.twist)
        if monitor is None:
            return limited, offer.cause_ns, self._free(source, offer.instance, pending)
        monitor.ignores_unseen = self.enters_unseen and source == "operator"
        verdict = monitor.judge(limited, speed, sensed.platform_ns * 1e-9)
        self.speed, self.turn = verdict.twist.vx, verdict.twist.wz
        return verdict.twist, offer.cause_ns, self._status(source, offer.instance, verdict, pending)

    def look_again(self, status: GateStatus, time: float) -> tuple[Twist2D, GateStatus] | None:
        """Slow down or stop for what was seen after the last command, s of run time; None where that is still free."""
        if self.monitor is None or status.stopped:
            return None
        verdict = self.monitor.judge(Twist2D(self.speed, 0.0, self.turn), self.speed, time)
        if not verdict.kind:
            return None
        self.speed, self.turn = verdict.twist.vx, verdict.twist.wz
        return verdict.twist, self._status(status.source, status.instance, verdict, status.pending)

    def _status(self, source: Any, instance: str, verdict: Verdict, pending: Sequence[str]) -> GateStatus:
        """Who drives, and what the monitor makes of it, rounded so that noise alone is no news."""
        is_overridden = self.monitor is not None and self.monitor.ignores_unseen
        if not verdict.kind and verdict.share == 1.0 and not is_overridden:
            return self._free(source, instance, pending)
        place, distance, is_stopped = verdict.place, verdict.distance, verdict.is_stopped
        share, limit = round(verdict.share, 1), verdict.kind or ("overridden" if is_overridden else "")
        where = None if place is None else (round(place.x, 1), round(place.y, 1))
        gap = None if distance is None else round(distance, 2)
        return self._said((source, instance, is_stopped, tuple(pending), share, limit, where, gap))

    def _free(self, source: str, instance: str, pending: Sequence[str]) -> GateStatus:
        """Who drives, where nothing limits the command."""
        return self._said((source, instance, False, tuple(pending), 1.0, "", None, None))

    def _said(self, key: tuple[Any, ...]) -> GateStatus:
        """The status of source, instance, whether it is stopped, pending, share, limit, place and distance."""
        if self._last is None or self._last[0] != key:  # most ticks say what the one before said
            source, instance, is_stopped, pending, share, limit, where, gap = key
            reason, point = OBSTACLE if is_stopped else "", None if where is None else Point2D(*where)
            status = GateStatus(source, instance, is_stopped, False, reason, pending, share, limit, point, gap)
            self._last = key, status
        return self._last[1]

    def stop(self, reason: str, pending: Sequence[str]) -> GateStatus:
        """Nobody drives."""
        self.speed, self.turn = 0.0, 0.0
        return GateStatus("none", "", True, self.is_latched, reason, tuple(pending))

    def _refusal(
        self, source: str, offer: Offer | None, offers: Mapping[str, Offer | None], sensed: Sensed, epoch: int
    ) -> str:
        """Why this offer is not driven: nothing to drive, a stale part of the chain, or an older selection."""
        if offer is None:
            return f"{WAITING}{sensed.waiting}" if sensed.waiting else "no_trajectory"
        if sensed.gone and source != "operator":
            return f"gone: {sensed.gone}"
        required = ("controller", "avoider") if source in ("controller", "avoider") else (source,)
        for role in required:
            part = offers.get(role)
            if part is None:
                return f"{WAITING}{sensed.waiting}" if sensed.waiting else f"silent: {role}"
            if abs(sensed.platform_ns - part.cause_ns) > self.limits.stop_deadline_ns:
                return f"stale: {role} {part.instance}"
        if offer.epoch < epoch and source != "operator":
            return f"old_selection: {source} {offer.instance}"
        return ""

    def _limit(self, twist: Twist2D) -> Twist2D:
        limits = self.limits
        wanted = min(max(twist.vx, -limits.linear), limits.linear)
        speeding_up = abs(wanted) > abs(self.speed) and wanted * self.speed >= 0.0
        step = (limits.acceleration if speeding_up else limits.deceleration) * limits.period
        speed = min(max(wanted, self.speed - step), self.speed + step)
        turn = min(max(twist.wz, -limits.angular), limits.angular)
        if limits.turn_acceleration < math.inf:
            step = limits.turn_acceleration * limits.period
            turn = min(max(turn, self.turn - step), self.turn + step)
        self.speed, self.turn = speed, turn
        return Twist2D(speed, 0.0, turn)
