"""The child's side of the bridge: draws messages into a file and to a viewer."""

from __future__ import annotations

import os
import queue
import signal
from multiprocessing.connection import Connection
from time import monotonic
from typing import Any

from navloom.plugins import Discovery

from navloom_viewer.drawing import Drawing, Sink
from navloom_viewer.drawing_task import NICE, ViewerOrder
from navloom_viewer.live_sink import LiveSink
from navloom_viewer.panels import panels_of
from navloom_viewer.rerun_stream import FileSink
from navloom_viewer.viewer_errors import ViewerError

__all__ = ["serve"]

FLUSH = 0.2
"""Interval of time series deliveries, s."""


def serve(order: ViewerOrder, inbox: Any, words: Connection) -> None:
    """Draw until None is received or the parent is gone. Never returns: the process ends here.

    The abrupt end is intended: at a normal exit the SDK waits for a viewer that may be frozen.
    """
    os.environ.setdefault("RUST_LOG", "off")  # a closed viewer is not an error, and dropped messages are counted here
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C and ends this process
    os.nice(NICE)
    parent = os.getppid()
    try:
        live = None if order.url is None else LiveSink(order.url, order.facts.title, order.recording_id, order.patience)
        file = None if order.file is None else FileSink(order.file, order.facts.title, order.recording_id)
        sinks: list[Sink] = [sink for sink in (file, live) if sink is not None]
        panels, wrong = panels_of(Discovery(order.blocked))
        drawing = Drawing(order.facts, sinks, panels)
        drawing.begin()
    except ViewerError as error:
        words.send(("refused", str(error)))
        os._exit(2)
    words.send(("ready",))
    drawn = _draw(drawing, inbox, parent)
    drawing.close()
    notes = (*wrong, *drawing.broken.values())
    dropped, connections = (0, 0) if live is None else (live.dropped, live.connections)
    if os.getppid() == parent:
        words.send(("done", drawn, dropped, connections, notes, "" if file is None else file.failure))
    os._exit(0)


def _draw(drawing: Drawing, inbox: Any, parent: int) -> int:
    drawn, flushed = 0, monotonic()
    while True:
        try:
            shown = inbox.get(timeout=FLUSH)
        except queue.Empty:
            if os.getppid() != parent:
                return drawn
        else:
            if shown is None:
                return drawn
            drawing.take(shown)
            drawn += 1
        if monotonic() - flushed >= FLUSH:
            flushed = monotonic()
            drawing.flush()
