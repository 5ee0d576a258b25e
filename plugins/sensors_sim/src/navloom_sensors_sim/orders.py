"""Commands on their way to the wheels: what holds for how long within a tick."""

from __future__ import annotations

__all__ = ["Orders"]

Leg = tuple[float, float, float]


class Orders:
    """Commands with the times at which they reach the wheels, ns, until the tick that they fall into is driven.

    Args:
        dead_time_ns: From a command to the wheels, ns. Without one, a tick that no order falls into is driven with the
            command that it is given.
    """

    def __init__(self, dead_time_ns: int = 0) -> None:
        self._dead_time_ns = dead_time_ns
        self._waiting: list[tuple[int, float, float]] = []
        self._holds: tuple[float, float] | None = None
        self._come_between_ticks = False

    def give(self, time_ns: int, vx: float, wz: float) -> None:
        """Drive with a speed, m/s, and turn rate, rad/s, that is commanded at a time, also between two ticks."""
        self._come_between_ticks = True
        self._wait(time_ns, vx, wz)

    def _wait(self, time_ns: int, vx: float, wz: float) -> None:
        self._waiting.append((time_ns + self._dead_time_ns, vx, wz))

    def legs(self, begin_ns: int, end_ns: int, command: tuple[float, float]) -> list[Leg]:
        """(speed, turn rate, duration in s) from begin to end; the tick's own command where none came between ticks."""
        if self._dead_time_ns and not self._come_between_ticks:
            self._wait(begin_ns, *command)
        due = [order for order in self._waiting if order[0] < end_ns]
        if not due and self._holds is None and not self._dead_time_ns:
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
