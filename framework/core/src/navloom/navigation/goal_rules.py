"""The rules of the goal's state machine, and its view of one tick."""

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
from navloom.navigation.braking import Braking
from navloom.navigation.replanning import ReplanRules

__all__ = ["GoalRules", "GoalView"]


@dataclass(frozen=True)
class GoalRules:
    """Tolerances, timeouts and limits of goals.

    Attributes:
        tolerance: Largest distance from the goal at arrival, m.
        heading_tolerance: Largest heading error at arrival, rad, if the goal has a heading.
        stuck_after: Time without progress before a recovery, s.
        max_recoveries: Most recoveries for one goal.
        patience: How long a goal that would end without a way tries again, in all, s.
        map_timeout, plan_timeout: How long to wait for a map or a plan, s.
        localizer_timeout: How long to wait for a localizer that is not tracking before the goal ends lost, s.
        searchers: Localizers that can search and recoveries that look around, as "role instance".
        deadline: Run time at which a goal times out, s; live, how long a goal may take, s.
        braking: How the robot comes to rest.
        fastest: Largest speed of the reference, m/s.
        cruise: Speed that the robot is expected to reach where nothing limits it, m/s; above `fastest` if an avoider
            drives, which follows no reference.
        is_live: The run has no end of its own, and messages can be lost.
        replan: Rules for replanning while driving.
        scans_on_request: The mapper depends on stop-and-scan sweeps, which must be requested.
        feedback_ticks: Ticks between two feedback messages.
    """

    tolerance: float
    heading_tolerance: float
    stuck_after: float
    max_recoveries: int
    map_timeout: float
    plan_timeout: float
    localizer_timeout: float
    deadline: float
    scans_on_request: bool
    feedback_ticks: int
    braking: Braking
    fastest: float
    cruise: float
    # In lockstep no message is lost, so that no request is repeated, and a run has one deadline for all goals.
    is_live: bool = False
    patience: float = 0.0
    replan: ReplanRules = field(default_factory=ReplanRules)
    searchers: frozenset[str] = frozenset()


# Not frozen, as a message would be: one view is made per tick and filled by the goal's node.
@dataclass(slots=True)
class GoalView:
    """What the goal sees in a tick: the newest message of each kind, or None."""

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
    is_through_seen: bool = False
    """The answer is a path of the known map that leads through what the mapper has seen: no other was found."""
    speed: float = 0.0
    """Forward speed that the gate last commanded, m/s."""
    looks_around: bool = False
    """The active localizer can search, and the active recovery looks around meanwhile."""

    @property
    def stop_kind(self) -> str:
        """Kind of the gate's stop; empty for none."""
        return "" if self.gate is None or self.gate.why is None else self.gate.why.kind
