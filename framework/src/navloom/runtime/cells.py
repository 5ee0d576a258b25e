"""From a built system to the cells of one process."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from navloom.engine.assembly import make_stepper
from navloom.engine.build import System
from navloom.engine.catalogue import answer_ports, node_class
from navloom.engine.node import Node
from navloom.engine.ports import Input
from navloom.engine.streams import GatePorts, OperatorPorts, PlatformPorts
from navloom.engine.wiring import Slot, Wire, make_wire
from navloom.runtime.cell import Cell, Feed, Source
from navloom.runtime.keyspace import FAULT, STEP
from navloom.runtime.mailbox import Mailbox
from navloom.runtime.switchboard import Switchboard

__all__ = ["Hosted", "all_sources", "awaited", "make_cell"]

FEW, MANY = 1, 1024
REQUESTS = Input("operator.request", OperatorPorts.request, "new")
SELECTION = Input("gate.selection", GatePorts.selection, delayed=True)


@dataclass(eq=False)
class Hosted:
    """A cell with what every node hears beside its own inputs: the operator's requests and the gate's selection."""

    cell: Cell
    requests: Feed
    selection: Feed


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
    spec = next(spec for spec in system.specs if spec.role == source[0])
    sources = all_sources(system)
    stepper = make_stepper(system, spec, source[1], node)
    feeds: list[Feed] = []
    for given in spec.inputs:
        feeds += _feeds(system, given, sources, board, mailbox)
    stepper.connect([next(feed for feed in feeds if feed.wire.input is given).wire for given in spec.inputs])
    cell = Cell(
        stepper,
        mailbox,
        feeds,
        {other: board.inlet(other, STEP, mailbox, FEW) for other in _reporting(source, feeds, sources, board)},
        {port: board.outlet(source, port) for port in (*spec.outputs, STEP)},
        {role: system.config.role_table(role).instance for role in system.config.roles},
    )
    if not board.lossless:
        cell.fault = board.outlet(source, FAULT)
        if node.hears == "faults":
            cell.faults = {other: board.inlet(other, FAULT, mailbox, MANY, rings=False) for other in sources}
            (platform,) = [other for other in sources if other[0] == "platform"]
            cell.platform = board.inlet(platform, PlatformPorts.odometry.name, mailbox, FEW, rings=False)
    control = [_feeds(system, given, sources, board, mailbox)[0] for given in (REQUESTS, SELECTION)]
    return Hosted(cell, *control)


def awaited(source: Source, feeds: Sequence[Feed]) -> set[Source]:
    """Instances whose step of a tick is worth waiting for a moment before a node's own step of it."""
    return {
        feed.source
        for feed in feeds
        if not feed.wire.delayed and node_class(feed.source[0]).is_awaited and feed.source != source
    }


def _reporting(
    source: Source, feeds: Sequence[Feed], sources: Sequence[Source], board: Switchboard
) -> Iterable[Source]:
    """Instances whose step reports a node hears: none that it has no use for."""
    if board.lossless:
        return sources
    roles = [role for role, _ in sources]
    if node_class(source[0]).hears == "rivals":
        return [other for other in sources if other[0] == "goal" or roles.count(other[0]) > 1]
    silent = {feed.source for feed in feeds if not feed.wire.delayed and not _answers(feed)}
    waits_for = awaited(source, feeds) & silent
    return [other for other in sources if other in waits_for]


def _answers(feed: Feed) -> bool:
    """A message comes by this feed in every step of its instance, and tells as much as the report of the step."""
    return feed.wire.input.port in answer_ports(feed.source[0])


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
