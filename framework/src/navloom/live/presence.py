"""Who is there: liveliness tokens of a robot's instances."""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Callable, Iterable

from navloom.live.cell import Source
from navloom.transport.keyspace import KeySpace

__all__ = ["Presence"]

LIVES = 16
"""Lives that one instance may have at once: more are no robot's, and are not heeded."""
AGAIN = 0.5
"""s between two meetings with one instance: one that comes and goes all the time takes no more than that."""
LOOK = 0.2
"""s between two looks whether it ends, where nobody comes up."""


class Presence:
    """Keeps who is alive, from the bus's liveliness changes.

    Args:
        keys: Of the robot.
        own: Instances of this process, which are there as long as it is.
        came: Told of an instance that came up, and whether it had been there before in another life.
    """

    def __init__(self, keys: KeySpace, own: Iterable[Source], came: Callable[[Source, bool], None]) -> None:
        self._keys, self._came = keys, came
        self._own = frozenset(own)
        self._lives: dict[Source, set[str]] = {}
        self._last: dict[Source, str] = {}
        self._arrivals: queue.Queue[Source] = queue.Queue()
        self._queued: set[Source] = set()

    def change(self, key: str, alive: bool) -> None:
        """A token appeared or vanished; called on the network's thread."""
        role, name, rest = self._keys.split(key)
        source, life = (role, name), rest.rpartition("/")[2]
        lives = self._lives.setdefault(source, set())
        if alive and life not in lives and len(lives) < LIVES:
            lives.add(life)
            if source not in self._queued:
                self._queued.add(source)
                self._arrivals.put(source)
            before = self._last.get(source, life)
            self._last[source] = life
            self._came(source, before != life)
        elif not alive:
            lives.discard(life)

    def is_alive(self, source: Source) -> bool:
        """Its token is there, or it is of this process."""
        return source in self._own or bool(self._lives.get(source))

    def follow(self, meet: Callable[[Source], None], ends: Callable[[], bool]) -> None:
        """Have each that comes up met once, on the thread that calls this, until it ends."""
        met: dict[Source, float] = {}
        while not ends():
            with contextlib.suppress(queue.Empty):
                source = self._arrivals.get(timeout=LOOK)
                early = met.get(source, -AGAIN) + AGAIN - time.monotonic()
                if early > 0.0:
                    if self._arrivals.empty():
                        time.sleep(min(early, LOOK))
                    self._arrivals.put(source)
                    continue
                self._queued.discard(source)
                met[source] = time.monotonic()
                meet(source)
