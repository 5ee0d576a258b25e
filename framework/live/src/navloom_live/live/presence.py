"""Which instances of a robot are alive, by their liveliness tokens."""

from __future__ import annotations

import contextlib
import os
import platform
import queue
import time
import uuid
from collections.abc import Callable, Iterable

from navloom_live.live.live_node import Source
from navloom_live.transport.keyspace import KeySpace, key_part

__all__ = ["Presence", "life_here"]

LIVES = 16
"""Most tokens that one instance may have at once; further ones are ignored."""
MEET_INTERVAL = 0.5
"""Shortest time between two calls of `meet` for one instance, s, even if it restarts all the time."""
ARRIVAL_CHECK_INTERVAL = 1.0
"""Interval of checking for the end while no instance comes up, s."""
MEET_RETRY_INTERVAL = 0.2
"""Interval of looking for other instances while one has to wait, s."""


def life_here() -> str:
    """Identifier of a life of this process, with its host and process ID, as the last part of its tokens."""
    return f"{uuid.uuid4().hex[:8]}~{os.getpid()}~{key_part(platform.node())}"


class Presence:
    """Knows which instances are alive, from liveliness changes on the bus.

    Args:
        keys: Keys of the robot.
        own: Instances of this process, which are alive as long as it runs.
        came: Called with an instance that came up, and whether it is a restart.
    """

    def __init__(self, keys: KeySpace, own: Iterable[Source], came: Callable[[Source, bool], None]) -> None:
        self._keys, self._came = keys, came
        self._own = frozenset(own)
        self._lives: dict[Source, set[str]] = {}
        self._last: dict[Source, str] = {}
        self._arrivals: queue.Queue[Source] = queue.Queue()
        self._queued: set[Source] = set()

    def change(self, key: str, alive: bool) -> None:
        """Take the appearance or disappearance of a token. Called on the network's thread."""
        role, name, rest = self._keys.split(key)
        source, life = (role, name), rest.rpartition("/")[2]
        lives = self._lives.setdefault(source, set())
        if alive and life not in lives and len(lives) < LIVES:
            lives.add(life)
            # Once, however often it restarts meanwhile.
            if source not in self._queued:
                self._queued.add(source)
                self._arrivals.put(source)
            # The first life is no restart.
            before = self._last.get(source, life)
            self._last[source] = life
            self._came(source, before != life)
        elif not alive:
            lives.discard(life)

    def is_alive(self, source: Source) -> bool:
        """Whether an instance has a token, or belongs to this process."""
        return source in self._own or bool(self._lives.get(source))

    def processes(self, source: Source) -> str:
        """The processes that run an instance, in words: their lives name host and process, see `life_here`."""
        lives = sorted(self._lives.get(source, ()))
        parts = [life.split("~") for life in lives]
        named = [f"on host {part[2]} (process {part[1]})" for part in parts if len(part) == 3]
        return " and ".join(named) if len(named) > 1 else "in two processes, of which one has announced no node"

    def last_life(self, source: Source) -> str:
        """Life of the process that last announced an instance, also if its token is gone; empty for none."""
        return self._last.get(source, "")

    def follow(self, meet: Callable[[Source], None], ends: Callable[[], bool]) -> None:
        """Call `meet` once for each instance that comes up, on the calling thread, until the process ends."""
        met: dict[Source, float] = {}
        while not ends():
            with contextlib.suppress(queue.Empty):
                source = self._arrivals.get(timeout=ARRIVAL_CHECK_INTERVAL)
                early = met.get(source, -MEET_INTERVAL) + MEET_INTERVAL - time.monotonic()
                # A process that crashes at each start would otherwise be queried all the time.
                if early > 0.0:
                    if self._arrivals.empty():
                        time.sleep(min(early, MEET_RETRY_INTERVAL))
                    self._arrivals.put(source)
                    continue
                self._queued.discard(source)
                met[source] = time.monotonic()
                meet(source)
