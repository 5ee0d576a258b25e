"""Who is there: liveliness tokens of a robot's instances."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterable

from navloom.runtime.cell import Source
from navloom.runtime.keyspace import KeySpace

__all__ = ["Presence"]


class Presence:
    """Keeps who is alive, from the bus's liveliness changes.

    Args:
        keys: Of the robot.
        own: Instances of this process, which are there as long as it is.
        came: Told of an instance that came up, and whether it had been there before.
    """

    def __init__(self, keys: KeySpace, own: Iterable[Source], came: Callable[[Source, bool], None]) -> None:
        self._keys, self._came = keys, came
        self._own = frozenset(own)
        self._alive: dict[Source, bool] = {}
        self._arrivals: queue.Queue[Source] = queue.Queue()

    def change(self, key: str, alive: bool) -> None:
        """A token appeared or vanished; called on the network's thread."""
        role, name, _ = self._keys.split(key)
        source = (role, name)
        was = self._alive.get(source)
        self._alive[source] = alive
        if alive and not was:
            self._arrivals.put(source)
            self._came(source, was is not None)

    def is_alive(self, source: Source) -> bool:
        """Its token is there, or it is of this process."""
        return source in self._own or self._alive.get(source, False)

    def next_arrival(self, timeout: float) -> Source | None:
        """Somebody who came up, once; None where nobody does within s."""
        try:
            return self._arrivals.get(timeout=timeout)
        except queue.Empty:
            return None
