"""From a built system to the cells of one process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from navloom.engine.assembly import make_stepper
from navloom.engine.build import System
from navloom.engine.catalogue import Catalogue
from navloom.engine.node import Node
from navloom.engine.ports import Input
from navloom.engine.streams import GatePorts, OperatorPorts
from navloom.engine.wiring import Slot, Wire, make_wire
from navloom.runtime.cell import Cell, Feed, Source
from navloom.runtime.keyspace import STEP
from navloom.runtime.mailbox import Mailbox
from navloom.runtime.switchboard import Switchboard

__all__ = ["Hosted", "all_sources", "awaited", "make_cell"]

FEW, MANY = 1, 1024
REQUESTS = Input("operator.request", OperatorPorts.request, "new")
SELECTION = Input("gate.selection", GatePorts.selection, delayed=True)


@dataclass(eq=False)
class Hosted:
    """A cell with what every node hears beside its own inputs: the operator's requests and the gate's selection.

    Attributes:
        awaited: Instances whose step of a tick is worth waiting for a moment before the node's own step of it.
    """

    cell: Cell
    requests: Feed
    selection: Feed
    awaited: set[Source]


def all_sources(system: System) -> list[Source]:
    """Every instance of the robot in the order of the graph, of a role the one in charge first; the operator's too."""
    found: list[Source] = []
    for spec in system.specs:
        names = [name for role, name in system.parts if role == spec.role] or ["main"]
        found += [(spec.role, name) for name in names]
    return found


def make_cell(system: System, source: Source, node: Node, board: Switchboard, mailbox: Mailbox | None = None) -> Hosted:
    """One node of this process with its feeds, not connected yet."""
    mailbox = mailbox or Mailbox()
    sources = all_sources(system)
    stepper = make_stepper(system, *source, node)
    spec = stepper.spec
    feeds: list[Feed] = []
    for given in spec.inputs:
        feeds += _feeds(system, given, sources, board, mailbox)
    stepper.connect([next(feed for feed in feeds if feed.wire.input is given).wire for given in spec.inputs])
    waits_for = awaited(system.catalogue, source, feeds)
    hears = sources if board.lossless or node.hears_all else [other for other in sources if other in waits_for]
    cell = Cell(
        stepper,
        mailbox,
        feeds,
        {other: board.inlet(other, STEP, mailbox, FEW) for other in hears},
        {port: board.outlet(source, port) for port in (*spec.outputs, STEP)},
        {role: system.config.role_table(role).instance for role in system.config.roles},
    )
    control = [_feeds(system, given, sources, board, mailbox)[0] for given in (REQUESTS, SELECTION)]
    return Hosted(cell, control[0], control[1], waits_for)


def awaited(catalogue: Catalogue, source: Source, feeds: Sequence[Feed]) -> set[Source]:
    """Instances whose step of a tick is worth waiting for a moment before a node's own step of it."""
    return {
        feed.source
        for feed in feeds
        if not feed.wire.delayed and catalogue.nodes[feed.source[0]].is_awaited and feed.source != source
    }


def _feeds(system: System, given: Input, sources: Sequence[Source], board: Switchboard, mailbox: Mailbox) -> list[Feed]:
    """A feed of each instance into one input; the wire leads to the first, which is in charge."""
    limit = MANY if given.reading in ("new", "track") else FEW
    feeds: list[Feed] = []
    wire: Wire | None = None
    for other in sources:
        if other[0] == given.role:
            slot = Slot(board.keys.port(*other, given.port), f"{other[0]} {other[1]} {given.port}")
            wire = wire or make_wire(given, slot)
            feeds.append(Feed(wire, board.inlet(other, given.port, mailbox, limit), slot, other))
    return feeds
