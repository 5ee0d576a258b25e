"""A gate with a monitor whose verdicts a test gives, and one tick of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from limits import with_robot
from navloom.messages import GateStatus, Point2D, Twist2D
from navloom.navigation.collision_monitor import Verdict
from navloom.navigation.command_gate import STOPPED, CommandGate, GateLimits, Offer, Sensed
from navloom.testing import robot

LIMITS = GateLimits(
    robot(max_linear=0.7, max_angular=0.9, max_acceleration=0.6, max_deceleration=1.1, max_angular_acceleration=1.3),
    period=0.05, stop_deadline_ns=100_000_000, sensor_timeout_ns=500_000_000,
)  # fmt: skip
FREE = with_robot(LIMITS, max_acceleration=1e3, max_deceleration=1e3, max_angular_acceleration=math.inf)
"""Limits that let any speed begin at once."""
NOW = 1_000_000_000


def offer(vx: float = 0.3, wz: float = 0.0, age_ns: int = 0, epoch: int = 3, name: str = "a") -> Offer:
    return Offer(name, Twist2D(vx, 0.0, wz), NOW - age_ns, epoch)


def sensed(**more: Any) -> Sensed:
    return Sensed(**{"platform_ns": NOW, "touching": False, "sensors_ns": {}, **more})


def decide(
    gate: CommandGate,
    offers: dict[str, Offer | None],
    seen: Sensed | None = None,
    engaged: bool = False,
    epoch: int = 3,
) -> tuple[Twist2D, int, GateStatus]:
    return gate.decide(seen or sensed(), offers, engaged, epoch, ())


@dataclass
class Judge:
    """A monitor that gives one verdict, by default what it is asked, and keeps its questions."""

    verdict: Verdict | None = None
    ignores_unseen: bool = False
    asked: list[tuple[Twist2D, float, float, bool]] = field(default_factory=list)

    def judge(self, twist: Twist2D, speed: float, time: float) -> Verdict:
        self.asked.append((twist, speed, time, self.ignores_unseen))
        return self.verdict or Verdict(twist)


def judged(verdict: Verdict | None = None, limits: GateLimits = FREE) -> tuple[CommandGate, Judge]:
    judge = Judge(verdict)
    return CommandGate(limits, judge), judge  # type: ignore[arg-type]


WALL = Verdict(Twist2D(0.21, 0.0, 0.07), 0.34, "obstacle", Point2D(0.449, -0.251), 0.127)
HALT = Verdict(STOPPED, 0.0, "unseen", Point2D(0.4, 0.0), 0.4)
