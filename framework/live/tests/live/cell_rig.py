"""What stands in for the bus of a cell whose test gives the messages itself."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from navloom.messages import Envelope
from navloom_live.live.live_node import Cell
from navloom_live.live.mailbox import Inlet


def silent_bus() -> Any:
    """A bus that accepts everything and delivers nothing, for runners whose test gives the messages itself."""
    return SimpleNamespace(
        publication=lambda *given: SimpleNamespace(is_heard=True, put=lambda data, label: None),
        serve=lambda *given, **more: None,
        subscribe=lambda *given: None,
    )


def give(cell: Cell, key: str, message: Any, tick: int, *, sequence: int | None = None, stamp_ns: int = 0) -> None:
    """Deliver a message to the inlets of a cell that read a key, and to its inlets of step reports."""
    envelope = Envelope(key, tick + 1 if sequence is None else sequence, tick, stamp_ns, stamp_ns, 0)
    for inlet in inlets(cell, key):
        inlet.give((message, envelope))


def inlets(cell: Cell, key: str) -> list[Inlet]:
    """The inlets of a cell that read a key, its inlets of step reports included."""
    return [inlet for inlet in [*(feed.inlet for feed in cell.feeds), *cell.reports.values()] if inlet.key == key]
