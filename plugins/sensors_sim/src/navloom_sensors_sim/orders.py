"""Commands that come between two ticks: what holds for how long within one."""

from __future__ import annotations

__all__ = ["Orders"]

Leg = tuple[float, float, float]


class Orders:
    """Commands with their times, ns, until the tick they fall into is driven."""

    def __init__(self) -> None:
        self._waiting: list[tuple[int, float, float]] = []
        self._holds: tuple[float, float] | None = None

    def give(self, time_ns: int, vx: float, wz: float) -> None:
        """From a time on, drive with a speed, m/s, and turn rate, rad/s."""
        self._waiting.append((time_ns, vx, wz))

    def legs(self, begin_ns: int, end_ns: int, command: tuple[float, float]) -> list[Leg]:
        """(speed, turn rate, duration in s) from begin to end; the tick's own command where none came."""
        due = [order for order in self._waiting if order[0] < end_ns]
        if not due and self._holds is None:
            return [(*command, (end_ns - begin_ns) / 1e9)]
        self._waiting = self._waiting[len(due) :]
        holds, at, legs = self._holds or (0.0, 0.0), begin_ns, []
        for time_ns, vx, wz in due:
            if time_ns > at:
                legs.append((*holds, (time_ns - at) / 1e9))
                at = time_ns
            holds = (vx, wz)
        self._holds = holds
        return [*legs, (*holds, (end_ns - at) / 1e9)]
