"""A sink for a viewer that may be slow, frozen, absent, killed or restarted: drawing never waits for it."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom_viewer.program import address_of
from navloom_viewer.rerun_stream import send, send_series, stream

__all__ = ["LiveSink"]

MOST_BYTES, MOST_ITEMS = 64 * 2**20, 50_000
"""Most bytes, and most items, that wait for the viewer; beyond that the oldest are dropped."""
VIEWER_CHECK_INTERVAL = 0.25
"""Interval of checks for a viewer, s."""

Send = Callable[[Any], None]


class LiveSink:
    """Sends drawings to a viewer from a separate thread.

    The rerun SDK blocks while a viewer does not read, and does not reconnect. So the sending thread is expendable, a
    separate connection detects when a viewer has gone, and the next viewer gets a new stream with the current scene.

    Args:
        url: URL of the viewer.
        title: Name of the recording in the viewer.
        recording_id: Identifier, equal for the same run.
        patience: Longest wait of `log` and `series` for room before old items are dropped, s: 0 for live runs.
    """

    def __init__(self, url: str, title: str, recording_id: str, patience: float = 0.0) -> None:
        self.url, self.title, self.recording_id, self.patience = url, title, recording_id, patience
        self.host, self.port = address_of(url)
        self.sent = self.dropped = self.connections = 0
        self._waiting: deque[tuple[Send, int]] = deque()
        self._bytes = 0
        self._scene: dict[str, Send] = {}
        self._layout: Send | None = None
        self._changed = threading.Condition()
        self._generation = 0
        self._connected = self._is_stuck = self._closing = False
        # Daemons, both threads: they must not keep the process alive while a viewer is frozen.
        self._watcher = threading.Thread(target=self._watch, name="viewer watcher", daemon=True)
        self._watcher.start()

    def layout(self, blueprint: Any) -> None:
        """Set the layout; each new viewer gets it too."""
        with self._changed:
            self._layout = lambda to: to.send_blueprint(blueprint)
        # A guess: the size of a blueprint is not known before it is encoded, and it is small beside maps.
        self._put(self._layout, 4096)

    def log(self, path: str, archetypes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
        """Log shapes of an entity."""

        def act(to: Any) -> None:
            send(to, path, archetypes, tick, stamp_ns)

        # Text lines add up in the viewer; they are no state, and repeating the last one would date it wrongly.
        if not path.startswith("/log/"):
            with self._changed:
                # A new viewer first gets all static shapes and the last ones of the other entities.
                self._scene[path if tick is not None else f"{path} {len(archetypes)} static"] = act
        self._put(act, _size(archetypes))

    def series(
        self, path: str, ticks: NDArray[np.int64], stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Add values to a time series."""
        # 24 = 8 bytes each for tick, stamp and value.
        self._put(lambda to: send_series(to, path, ticks, stamps_ns, values), 256 + 24 * len(values))

    def close(self, patience: float = 5.0) -> None:
        """Wait, at most `patience` seconds, until a connected viewer has received everything."""
        limit = time.monotonic() + patience
        with self._changed:
            self._closing = True
            self._changed.notify_all()
            # Not connected means nobody will ever fetch the rest, so there is nothing to wait for.
            while self._connected and self._waiting and time.monotonic() < limit:
                self._changed.wait(0.1)
        self._watcher.join(max(0.1, limit - time.monotonic()))

    def _put(self, act: Send, size: int) -> None:
        with self._changed:
            # `_is_stuck`: a frozen viewer is waited for once, not again for each of the thousands of later drawings.
            if self.patience and self._connected and not self._is_stuck and not self._has_room(size):
                self._changed.wait_for(lambda: self._has_room(size), self.patience)
                self._is_stuck = not self._has_room(size)
            self._waiting.append((act, size))
            self._bytes += size
            # The last item always stays, even one larger than all the room: a huge map must be drawn at some time.
            while len(self._waiting) > 1 and not self._has_room(0, 0):
                self._bytes -= self._waiting.popleft()[1]
                self.dropped += 1
            self._changed.notify_all()

    def _has_room(self, size: int, items: int = 1) -> bool:
        return self._bytes + size <= MOST_BYTES and len(self._waiting) + items <= MOST_ITEMS

    def _watch(self) -> None:
        """Hold a separate connection; when it breaks, the viewer has gone and the next one gets a new stream."""
        while not self._is_done():
            try:
                # The SDK does not tell when a viewer has gone; a plain socket to its port ends with it.
                canary = socket.create_connection((self.host, self.port), VIEWER_CHECK_INTERVAL)
            except OSError:
                time.sleep(VIEWER_CHECK_INTERVAL)
                continue
            with canary:
                self._begin()
                while not self._is_done() and not _has_ended(canary):
                    pass
            with self._changed:
                # The sender of the last viewer may hang in the SDK for ever; it sees the new number if it ever comes
                # back.
                self._generation += 1
                self._connected = False
                self._changed.notify_all()

    def _begin(self) -> None:
        with self._changed:
            self._generation += 1
            self.connections += 1
            again = self.connections > 1
            # The first viewer gets everything from the queue itself.
            scene = [self._layout, *self._scene.values()] if again else []
            self._connected = True
        sender = threading.Thread(
            target=self._send_on, args=(self._generation, scene), name="viewer sender", daemon=True
        )
        sender.start()

    def _send_on(self, generation: int, scene: Sequence[Send | None]) -> None:
        """Send waiting items until this connection is no longer the current one. It may block forever."""
        to = stream(self.title, self.recording_id)
        to.connect_grpc(self.url)
        to.send_recording_name(self.title)
        for act in scene:
            if act is not None:
                act(to)
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing or generation != self._generation, 0.5)
                if generation != self._generation:
                    return
                if not self._waiting and self._closing:
                    break
                # Batches, so the lock is not taken per item; small, since a batch is lost if the viewer dies during it.
                ready = [self._waiting.popleft() for _ in range(min(256, len(self._waiting)))]
                self._bytes -= sum(size for _, size in ready)
                self._is_stuck = False
                self._changed.notify_all()
            # Outside the lock: `act` blocks while the viewer does not read, and `_put` must not.
            for act, _ in ready:
                act(to)
            self.sent += len(ready)
        to.flush(timeout_sec=5.0)
        with self._changed:
            self._connected = False
            self._changed.notify_all()

    def _is_done(self) -> bool:
        return self._closing and not self._connected


def _has_ended(canary: socket.socket) -> bool:
    """Whether the other end has closed; waits up to `VIEWER_CHECK_INTERVAL` seconds."""
    readable, _, _ = select.select([canary], [], [], VIEWER_CHECK_INTERVAL)
    if not readable:
        return False
    # A connection that was reset has ended too.
    with contextlib.suppress(OSError):
        return canary.recv(4096) == b""
    return True


def _size(archetypes: Sequence[Any]) -> int:
    """Approximate size of shapes, bytes."""
    return 256 + sum(
        int(batch.as_arrow_array().nbytes) for shape in archetypes for batch in shape.as_component_batches()
    )
