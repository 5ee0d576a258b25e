"""Planning anew while the robot drives: because the map now blocks its trajectory, or at a rate."""

from __future__ import annotations

import math
from dataclasses import dataclass

from navloom.messages import MapUpdate, Path, Reference, Trajectory
from navloom.navigation.blocking import first_blocked

__all__ = ["ReplanRules", "Replanning"]


@dataclass(frozen=True)
class ReplanRules:
    """When another path is asked for, and when it is taken.

    Attributes:
        when_blocked: A new map blocks the trajectory.
        period: s between two requests at a rate; 0 for none.
        gain: Share by which a path must be shorter than what is left of a free trajectory.
        radius: Of the disc that must fit on the trajectory, m: what no heading of the robot can do without.
    """

    when_blocked: bool = True
    period: float = 0.0
    gain: float = 0.1
    radius: float = 0.0


class Replanning:
    """Watches the trajectory that is driven."""

    def __init__(self, rules: ReplanRules) -> None:
        self.rules = rules
        self.blocked_at = math.inf
        """Arc length from which on the newest map blocks it, m; infinite where it is free."""
        self._seen: tuple[MapUpdate | None, Trajectory | None] = (None, None)
        self._answered: MapUpdate | None = None
        self._asked = -math.inf

    @property
    def is_blocked(self) -> bool:
        """The newest map blocks what is driven."""
        return math.isfinite(self.blocked_at)

    def look(self, given: MapUpdate | None, trajectory: Trajectory | None, reference: Reference | None) -> None:
        """Compare a new map, or a new trajectory, with the other."""
        if not self.rules.when_blocked or given is None or trajectory is None or reference is None:
            return
        if (given is self._seen[0] and trajectory is self._seen[1]) or reference.path_id != trajectory.path_id:
            return
        self._seen = (given, trajectory)
        self.blocked_at = first_blocked(trajectory.samples, reference.progress, self.rules.radius, given.grid)

    def asks(self, time: float) -> bool:
        """Whether a path is to be asked for at a run time, s; where it is, it counts as asked for."""
        blocked_anew = self.is_blocked and self._answered is not self._seen[0]  # one map is asked about once
        if blocked_anew:
            self._answered = self._seen[0]
        elif not 0.0 < self.rules.period <= time - self._asked + 1e-9:
            return False
        self._asked = time
        return True

    def takes(self, path: Path, reference: Reference | None) -> bool:
        """Whether a path is better than what is left of the trajectory."""
        if self.is_blocked or reference is None:
            return True
        return path.length < (1.0 - self.rules.gain) * reference.remaining
