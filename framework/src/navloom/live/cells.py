"""From a built system to the cells of one process."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from navloom.engine.assembly import make_stepper
from navloom.engine.catalogue import Catalogue
from navloom.engine.nodes.node import Node
from navloom.engine.ports import Input
from navloom.engine.streams import GatePorts, OperatorPorts, PlatformPorts
from navloom.engine.system import System
from navloom.engine.wiring import Slot, Wire, make_wire
from navloom.live.cell import Cell, Feed, Source
from navloom.live.mailbox import Mailbox
from navloom.live.switchboard import Switchboard
from navloom.transport.keyspace import FAULT, STEP

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
    """Every instance of the robot in the order of the graph, of a role the active one first; the operator's too."""
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
    hears = _reporting(system, source, feeds, sources, board, waits_for)
    cell = Cell(
        stepper,
        mailbox,
        feeds,
        {other: board.inlet(other, STEP, mailbox, FEW) for other in hears},
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
    return Hosted(cell, control[0], control[1], waits_for)


def awaited(catalogue: Catalogue, source: Source, feeds: Sequence[Feed]) -> set[Source]:
    """Instances whose step of a tick is worth waiting for a moment before a node's own step of it."""
    return {
        feed.source
        for feed in feeds
        if not feed.wire.delayed and catalogue.nodes[feed.source[0]].is_awaited and feed.source != source
    }


def _reporting(
    system: System,
    source: Source,
    feeds: Sequence[Feed],
    sources: Sequence[Source],
    board: Switchboard,
    waits_for: set[Source],
) -> Iterable[Source]:
    """Instances whose step reports a node hears: none that it has no use for."""
    if board.lossless:
        return sources
    roles = [role for role, _ in sources]
    if system.catalogue.nodes[source[0]].hears == "rivals":
        told = {other for other in sources if other[0] == "goal" or roles.count(other[0]) > 1} | set(system.may_wait)
        return [other for other in sources if other in told]
    silent = {feed.source for feed in feeds if not feed.wire.delayed and not _answers(system, feed)}
    return [other for other in sources if other in waits_for & silent]


def _answers(system: System, feed: Feed) -> bool:
    """A message comes by this feed in every step of its instance, and tells as much as the report of the step."""
    return feed.wire.input.port in system.catalogue.answer_ports(feed.source[0])


def _feeds(system: System, given: Input, sources: Sequence[Source], board: Switchboard, mailbox: Mailbox) -> list[Feed]:
    """A feed of each instance into one input; the wire leads to the first, which is active."""
    limit = MANY if given.reading in ("new", "track") else FEW
    feeds: list[Feed] = []
    wire: Wire | None = None
    for other in sources:
        if other[0] == given.role:
            slot = Slot(board.keys.port(*other, given.port), f"{other[0]} {other[1]} {given.port}")
            wire = wire or make_wire(given, slot)
            feeds.append(Feed(wire, board.inlet(other, given.port, mailbox, limit), slot, other))
    return feeds
