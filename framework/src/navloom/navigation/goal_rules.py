"""What the goal's state machine decides by, and what it sees in a tick."""

from __future__ import annotations

from dataclasses import dataclass, field

from navloom.messages import (
    AvoiderStatus,
    GateStatus,
    HandOver,
    MapUpdate,
    Path,
    PlanFailure,
    PoseEstimate,
    RecoveryStep,
    Reference,
    Trajectory,
)
from navloom.navigation.replanning import ReplanRules

__all__ = ["GoalRules", "GoalView"]


@dataclass(frozen=True)
class GoalRules:
    """What the goal decides by.

    Attributes:
        tolerance: m from the goal.
        heading_tolerance: rad, where the goal has a heading.
        stuck_after: s without progress before a recovery.
        max_recoveries: Attempts for one goal.
        map_timeout, plan_timeout: s to wait.
        deadline: Run time at which a goal times out, s; live, time it may take.
        is_live: The run has no end of its own, and what is sent can be lost.
        replan: While driving.
        scans_on_request: The mapper lives on stop-and-scan sweeps, so one has to be asked for.
        feedback_ticks: Ticks between two feedbacks.
    """

    tolerance: float
    heading_tolerance: float
    stuck_after: float
    max_recoveries: int
    map_timeout: float
    plan_timeout: float
    deadline: float
    scans_on_request: bool
    feedback_ticks: int
    is_live: bool = False
    replan: ReplanRules = field(default_factory=ReplanRules)


@dataclass(slots=True)
class GoalView:
    """What the goal sees in a tick; each the newest of its kind, or None."""

    tick: int
    time: float
    time_ns: int
    estimate: PoseEstimate | None = None
    map: MapUpdate | None = None
    answer: Path | PlanFailure | None = None
    avoider: AvoiderStatus | None = None
    handover: HandOver | None = None
    recovery: RecoveryStep | None = None
    gate: GateStatus | None = None
    reference: Reference | None = None
    selected: tuple[str, str] = ("", "")
    """Active instances of mapper and planner."""
    trajectory: Trajectory | None = None
