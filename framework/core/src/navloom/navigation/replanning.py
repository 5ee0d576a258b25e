"""Replanning while the robot drives: when the map blocks its trajectory, or periodically."""

from __future__ import annotations

import math
from dataclasses import dataclass

from navloom.messages import MapUpdate, Path, Reference, Trajectory
from navloom.navigation.blocked_trajectory import first_blocked

__all__ = ["ReplanRules", "Replanning"]


@dataclass(frozen=True)
class ReplanRules:
    """When another path is requested, and when it is taken.

    Attributes:
        when_blocked: Request a path when a new map blocks the trajectory.
        period: Time between periodic requests, s; 0 for none.
        gain: Share by which a path must be shorter than the rest of a free trajectory.
        radius: Radius of the disc that must fit on the trajectory, m: the area that the robot needs at any heading.
    """

    when_blocked: bool = True
    period: float = 0.0
    gain: float = 0.1
    radius: float = 0.0


class Replanning:
    """Watches the driven trajectory, and decides when to replan."""

    def __init__(self, rules: ReplanRules) -> None:
        self.rules = rules
        self.blocked_at = math.inf
        """Arc length at which the newest map blocks the trajectory, m; infinite if it is free."""
        self._seen: tuple[MapUpdate | None, Trajectory | None] = (None, None)
        self._answered: MapUpdate | None = None
        self._asked = -math.inf

    @property
    def is_blocked(self) -> bool:
        """Whether the newest map blocks the driven trajectory."""
        return math.isfinite(self.blocked_at)

    def look(self, given: MapUpdate | None, trajectory: Trajectory | None, reference: Reference | None) -> None:
        """Check the trajectory against the map if either is new."""
        if not self.rules.when_blocked or given is None or trajectory is None or reference is None:
            return
        # Identity suffices, because messages are immutable.
        if (given is self._seen[0] and trajectory is self._seen[1]) or reference.path_id != trajectory.path_id:
            return
        self._seen = (given, trajectory)
        self.blocked_at = first_blocked(trajectory.samples, reference.progress, self.rules.radius, given.grid)

    def asks(self, time: float) -> bool:
        """Whether to request a path at a run time, s; if so, the request counts as made."""
        blocked_anew = self.is_blocked and self._answered is not self._seen[0]  # one request for each map
        if blocked_anew:
            self._answered = self._seen[0]
        # Times are sums of ticks: rounding must not delay a period by a tick.
        elif not 0.0 < self.rules.period <= time - self._asked + 1e-9:
            return False
        self._asked = time
        return True

    def takes(self, path: Path, reference: Reference | None) -> bool:
        """Whether a path is better than the rest of the trajectory."""
        # However long it is, another path is better than one through an obstacle.
        if self.is_blocked or reference is None:
            return True
        # A robot that is turned away follows a trajectory badly if it restarts every second.
        return path.length < (1.0 - self.rules.gain) * reference.remaining
