"""Builds the cells of one process from a system."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from navloom.engine.catalogue import Catalogue
from navloom.engine.lockstep_builder import make_stepper
from navloom.engine.node_ports import Input
from navloom.engine.nodes.node_base import Node
from navloom.engine.streams import STEP, GatePorts, OperatorPorts, PlatformPorts
from navloom.engine.system import System
from navloom.engine.wiring import Slot, Wire, make_wire

from navloom_live.live.live_node import Cell, Feed, Source
from navloom_live.live.mailbox import LATEST, Inlet, Mailbox
from navloom_live.live.process_streams import Switchboard
from navloom_live.transport.keyspace import FAULT

__all__ = ["Hosted", "Widening", "all_sources", "awaited", "make_cell", "widen"]

FEW, MANY = 1, 1024
REQUESTS = Input("operator.request", OperatorPorts.request, "new")
SELECTION = Input("gate.selection", GatePorts.selection, delayed=True)


@dataclass(eq=False)
class Hosted:
    """A cell, and two feeds for every node in addition to its inputs: operators' requests and the gate's selection.

    Attributes:
        awaited: Instances for whose step of a tick the node briefly waits before its own step of that tick.
    """

    cell: Cell
    requests: Feed
    selection: Feed
    awaited: set[Source]


@dataclass(frozen=True)
class Widening:
    """What a running node reads of an instance that is added to its robot.

    Attributes:
        source: The instance.
        feeds: Its streams.
        reports: Step reports that the node needs from now on, by source.
        faults: Its fault reports, if the node acts on them.
        is_awaited: The node waits a moment for a step of the instance, once it is active.
    """

    source: Source
    feeds: Sequence[Feed]
    reports: Mapping[Source, Inlet]
    faults: Mapping[Source, Inlet]
    is_awaited: bool


def all_sources(system: System) -> list[Source]:
    """Every instance of the robot, operator included, in the order of the graph; of a role the active one first."""
    found: list[Source] = []
    for spec in system.specs:
        names = [name for role, name in system.parts if role == spec.role] or ["main"]
        found += [(spec.role, name) for name in names]
    return found


def make_cell(system: System, source: Source, node: Node, board: Switchboard, mailbox: Mailbox | None = None) -> Hosted:
    """One node of this process with its feeds. Its streams are not connected yet."""
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


def widen(system: System, hosted: Hosted, source: Source, board: Switchboard) -> Widening:
    """Further inlets of a running cell, for an instance that the system has gained. `board.connect` connects them."""
    cell = hosted.cell
    mailbox, sources = cell.mailbox, all_sources(system)
    # By identity: a wire has one feed for each instance.
    wires = {id(feed.wire): feed.wire for feed in cell.feeds if feed.source[0] == source[0]}
    feeds = [_feed(wire, source, board, mailbox) for wire in wires.values()]
    waits_for = awaited(system.catalogue, cell.source, feeds)
    hears = _reporting(system, cell.source, feeds, sources, board, waits_for)
    return Widening(
        source,
        feeds,
        {other: board.inlet(other, STEP, mailbox, FEW) for other in hears if other not in cell.reports},
        {source: board.inlet(source, FAULT, mailbox, MANY, rings=False)} if cell.faults else {},
        bool(waits_for),
    )


def awaited(catalogue: Catalogue, source: Source, feeds: Sequence[Feed]) -> set[Source]:
    """Instances for whose step of a tick a node briefly waits before its own step of that tick."""
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
    """Instances whose step reports a node needs."""
    # Under the barrier every node waits for all reports.
    if board.lossless:
        return sources
    roles = [role for role, _ in sources]
    if system.catalogue.nodes[source[0]].hears == "rivals":
        # The goal's reports are its heartbeat; those of roles with several instances show which can take over. Each
        # report costs its readers a wake-up, so the gate takes no others.
        told = {other for other in sources if other[0] == "goal" or roles.count(other[0]) > 1} | set(system.may_wait)
        return [other for other in sources if other in told]
    # Who publishes in every step needs no report to show that it stepped.
    silent = {feed.source for feed in feeds if not feed.wire.delayed and not _answers(system, feed)}
    return [other for other in sources if other in waits_for & silent]


def _answers(system: System, feed: Feed) -> bool:
    """Whether this feed brings a message in every step of its instance, which makes the step's report unnecessary."""
    return feed.wire.input.port in system.catalogue.answer_ports(feed.source[0])


def _feeds(system: System, given: Input, sources: Sequence[Source], board: Switchboard, mailbox: Mailbox) -> list[Feed]:
    """One feed for each instance that may provide an input; the wire is connected to the first, which is active."""
    feeds: list[Feed] = []
    for other in sources:
        if other[0] == given.role:
            # One wire for all instances of a role: a swap leads it to another slot.
            wire = feeds[0].wire if feeds else make_wire(given, _slot(given, other, board))
            feeds.append(_feed(wire, other, board, mailbox, None if feeds else wire.slot))
    return feeds


def _feed(wire: Wire, source: Source, board: Switchboard, mailbox: Mailbox, slot: Slot | None = None) -> Feed:
    """The stream of one instance into an input."""
    given = wire.input
    is_decisive = given.reading == "offers" or given.source is GatePorts.command  # see `RivalWatch`
    limit = MANY if given.reading in ("new", "track") else LATEST if is_decisive else FEW
    inlet = board.inlet(source, given.port, mailbox, limit)
    return Feed(wire, inlet, slot or _slot(given, source, board), source)


def _slot(given: Input, source: Source, board: Switchboard) -> Slot:
    place = f"{source[0]} {source[1]} {given.port}"
    return Slot(board.keys.port(*source, given.port), place, given.source.offset_ns)
