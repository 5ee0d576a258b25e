"""Delayed commands: which command drives the wheels for how long within a tick."""

from __future__ import annotations

__all__ = ["Orders"]

Leg = tuple[float, ...]
"""A command, and its duration, s."""


class Orders:
    """Queue of commands, each with the time at which it reaches the wheels, ns.

    Args:
        dead_time_ns: Delay from a command to the wheels, ns. If it is 0, a tick uses its own command until the first
            order takes effect.
    """

    def __init__(self, dead_time_ns: int = 0) -> None:
        self._dead_time_ns = dead_time_ns
        self._waiting: list[tuple[int, tuple[float, ...]]] = []
        self._holds: tuple[float, ...] | None = None
        self._come_between_ticks = False

    def give(self, time_ns: int, *command: float) -> None:
        """Queue a command, as speed, m/s, and turn rate, rad/s; its time may lie between two ticks."""
        self._come_between_ticks = True
        self._wait(time_ns, command)

    def _wait(self, time_ns: int, command: tuple[float, ...]) -> None:
        self._waiting.append((time_ns + self._dead_time_ns, command))

    def legs(self, begin_ns: int, end_ns: int, command: tuple[float, ...]) -> list[Leg]:
        """Legs of a tick; its own command counts only if `give` is not used."""
        # Live, `drive` gives the same command at its own time; taken twice, it would count twice.
        if self._dead_time_ns and not self._come_between_ticks:
            self._wait(begin_ns, command)
        due = [order for order in self._waiting if order[0] < end_ns]
        if not due and self._holds is None and not self._dead_time_ns:
            return [(*command, (end_ns - begin_ns) / 1e9)]
        self._waiting = self._waiting[len(due) :]
        holds, at, legs = self._holds or (0.0,) * len(command), begin_ns, []
        for time_ns, given in due:
            if time_ns > at:
                legs.append((*holds, (time_ns - at) / 1e9))
                at = time_ns
            holds = given
        self._holds = holds
        return [*legs, (*holds, (end_ns - at) / 1e9)]
