"""The commands of `navloom ros`: inspect a ROS network, show a navloom robot on it, export and import recordings."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from navloom.cli import App, AsJson, MapOptions, RobotOptions
from navloom.inputs import printable

from navloom_ros.errors import BadDefinition, BadName, RosError, UnknownType
from navloom_ros.graph import Graph, Listed
from navloom_ros.hashing import NOT_HASHED
from navloom_ros.message_types import DISTRIBUTIONS, Types
from navloom_ros.names import full_name, remapping
from navloom_ros.node import Node
from navloom_ros.qos import DEFAULT
from navloom_ros.serving.outlets import PUBLISHED, STREAMS
from navloom_ros.tokens import Entity
from navloom_ros.topics import Received
from navloom_ros.wire import ROUTER

__all__ = ["app"]

app = App(name="ros", help="Work with a ROS 2 network over Zenoh, without ROS.", no_args_is_help=True)

SHOWN = 12
"""Elements of a list that `echo` prints without --whole."""
FAILED, WRONG = 1, 2
"""Exit codes: failed while running; invalid request."""

Router = Annotated[str, typer.Option(metavar="ENDPOINT", help="The robot's Zenoh router.")]
Domain = Annotated[int, typer.Option(metavar="N", min=0, max=232, envvar="ROS_DOMAIN_ID", help="ROS domain.")]
Distribution = Annotated[
    str | None,
    typer.Option(
        "--distro",
        metavar="NAME",
        help="humble, jazzy, kilted or lyrical; by default the one with the publisher's type.",
    ),
]
Interfaces = Annotated[
    list[Path] | None,
    typer.Option("--interfaces", metavar="DIR", help="Definitions as package/msg/Name.msg; may repeat."),
]


@app.command()
def graph(router: Router = ROUTER, domain: Domain = 0, as_json: AsJson = False) -> None:
    """Print a ROS network's nodes, topics, services and actions."""
    with _refusals(), _joined(router, domain) as node:
        found, unread = _as_dict(node.graph, node.wire.session), node.graph.unread
    if as_json:
        typer.echo(json.dumps(found | {"unread": unread}))
        return
    if not found["nodes"]:
        typer.echo(f"no nodes in domain {domain} at {router}")
    for kind, entries in found.items():
        typer.echo(f"{kind}:" if entries else f"{kind}: none")
        for entry in entries:
            typer.echo(printable(f"  {entry if isinstance(entry, str) else _line(entry)}"))
    if unread:
        typer.echo(printable(f"not listed: {unread} entries that cannot be read, such as {node.graph.reason}"))


@app.command()
def echo(
    topic: Annotated[str, typer.Argument(metavar="TOPIC", help="Its name, as /scan.")],
    count: Annotated[int | None, typer.Option(metavar="N", min=1, help="End after N messages.")] = None,
    patience: Annotated[
        float, typer.Option("--wait", metavar="S", min=0.1, help="Longest wait for the first message, s.")
    ] = 5.0,
    whole: Annotated[bool, typer.Option("--whole", help="Print whole lists, not only their first elements.")] = False,
    router: Router = ROUTER,
    domain: Domain = 0,
    distribution: Distribution = None,
    interfaces: Interfaces = None,
    as_json: AsJson = False,
) -> None:
    """Print the messages of a topic as they arrive, until Ctrl-C.

    The last message of a latched topic is printed at once.
    """
    with _refusals():
        name = full_name(topic)
        with _joined(router, domain) as node:
            publisher = _publisher_of(node, name, patience)
            node.types = _types_for(publisher, distribution, interfaces or [])
            subscription = node.subscription(name, publisher.type_name, publisher.qos or DEFAULT)
            seen = 0
            while seen != count and (received := subscription.take(None if seen else patience)) is not None:
                typer.echo(_text(node.types, received, None if whole else SHOWN, as_json))
                seen += 1
        if not seen:
            raise RosError(f"{name}: no message within {patience:g} s {subscription.reason}".rstrip())


@app.command()
def export(
    recording: Annotated[Path, typer.Argument(metavar="RUN.MCAP", help="A recording of navloom.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.MCAP", help="File to write.")],
    distribution: Annotated[
        str, typer.Option("--distro", metavar="NAME", help="ROS 2 distribution of the messages.")
    ] = "jazzy",
    as_json: AsJson = False,
) -> None:
    """Export a recording as MCAP with ROS messages.

    Foxglove, PlotJuggler and rosbag2 open the file.
    """
    from navloom_ros.adapter import export as export_recording

    with _refusals():
        done = export_recording(recording, out, Types(distribution))
        if as_json:
            typer.echo(json.dumps(done))
            return
        for topic, number in sorted(done["messages"].items()):
            typer.echo(f"{topic}  {number}")
        if done["left_out"]:
            typer.echo(f"no counterpart in ROS: {', '.join(sorted(done['left_out']))}")
        if done["note"]:
            typer.echo(f"navloom ros: {done['note']}", err=True)


@app.command()
def serve(
    which: RobotOptions,
    router: Router = ROUTER,
    domain: Domain = 0,
    namespace: Annotated[
        str, typer.Option(metavar="NAME", help="Namespace of all topics, services and actions, as /robot1.")
    ] = "/",
    remap: Annotated[
        list[str] | None,
        typer.Option("--remap", metavar="OLD:=NEW", help="Another name for a topic, service or action; may repeat."),
    ] = None,
    publish: Annotated[
        str, typer.Option(metavar="LIST", help=f"What to publish: some of {','.join(STREAMS)}.")
    ] = ",".join(PUBLISHED),
    take: Annotated[
        str, typer.Option(metavar="LIST", help="What to take from the network: some of goals,pose; nothing by default.")
    ] = "",
    distribution: Annotated[
        str, typer.Option("--distro", metavar="NAME", help="ROS 2 distribution of the network.")
    ] = "jazzy",
) -> None:
    """Show a live robot to ROS tools, until Ctrl-C.

    Anyone who reaches the router of a ROS network can publish on it, so goals are taken only with --take goals.
    """
    from navloom_ros.serving.adapter import TAKEN, Serving
    from navloom_ros.serving.adapter import serve as serve_robot

    # No exception in the middle of something: the goal is to be cancelled while the robot can still be reached.
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: ending.set())
    with _refusals():
        wanted, taken = _listed(publish, "--publish", tuple(STREAMS)), _listed(take, "--take", TAKEN)
        reached = which.robot, which.connect, which.keys, which.insecure
        served = Serving(
            *reached, router, domain, namespace, Types(distribution), wanted, taken, remapping(remap or [])
        )
        serve_robot(served, ending.is_set, lambda text: typer.echo(f"navloom ros: {text}", err=True))


def _listed(text: str, option: str, known: tuple[str, ...]) -> list[str]:
    names = [name for name in text.split(",") if name]
    for name in names:
        if name not in known:
            raise BadName(f"{option}: got {name!r}, expected some of {','.join(known)}")
    return names


class Stamps(StrEnum):
    """Source of the stamps of an import."""

    header = "header"
    received = "received"


@app.command("import")
def import_(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="A .bag file, or the folder of a ROS 2 bag.")],
    out: Annotated[Path, typer.Option("--out", metavar="F.mcap", help="Recording to write.")],
    place: MapOptions,
    map_topic: Annotated[
        list[str] | None,
        typer.Option("--map-topic", metavar="TOPIC=NAME", help="Name of the sensor of a topic; may repeat."),
    ] = None,
    mount: Annotated[
        list[str] | None,
        typer.Option(
            "--mount",
            metavar="NAME=X,Y,YAW_DEG[,Z]",
            help="Mount of a sensor without a transform in the bag; may repeat.",
        ),
    ] = None,
    odom: Annotated[
        str | None,
        typer.Option("--odom", metavar="TOPIC", help="Odometry topic, if the bag has several; none for scans alone."),
    ] = None,
    stamps: Annotated[
        Stamps, typer.Option("--stamps", help="Stamps of the messages' headers, or the times of receipt.")
    ] = Stamps.header,
    run: Annotated[
        int | None,
        typer.Option("--run", metavar="N", min=1, help="Run to take if the clock jumps; by default the longest."),
    ] = None,
    namespace: Annotated[
        str, typer.Option("--namespace", metavar="NAME", help="Take only the topics of this robot, as /r1.")
    ] = "",
    base_frame: Annotated[
        str,
        typer.Option("--base-frame", metavar="FRAME", help="The robot's frame, if not base_link or base_footprint."),
    ] = "",
    as_json: AsJson = False,
) -> None:
    """Import a ROS 1 or ROS 2 bag.

    Laser scans, ranges, point clouds, odometry and mounts are imported, with their ROS stamps.
    """
    from navloom_recording import late_note

    from navloom_ros.adapter import import_from
    from navloom_ros.bag_import import Choice

    choice = Choice(namespace, base_frame, stamps is Stamps.received, run)
    with _refusals():
        found = import_from(bag, out, map_topic or (), mount or (), odom, place.map_, place.pose(), choice)
    found.notes += filter(None, [late_note(out)])
    span = (found.last_ns - found.first_ns) * 1e-9
    if as_json:
        topics = [topic.to_json() for topic in found.topics]
        typer.echo(json.dumps({"file": str(out), "seconds": span, "topics": topics, "notes": found.notes}))
        return
    for topic in found.topics:
        taken = f"{topic.messages} messages as {topic.sensor}" if topic.sensor else "not taken"
        reasons = "; ".join(f"{count}: {why}" if count else why for why, count in topic.skipped.most_common(3))
        typer.echo(printable(f"{topic.name}  {topic.type}  {taken}{f'  (left out: {reasons})' if reasons else ''}"))
    for note in found.notes:
        typer.echo(printable(note))
    written = sum(topic.messages for topic in found.topics if topic.sensor != "mounts")
    typer.echo(f"{out}: {written} messages over {span:.1f} s")


def _publisher_of(node: Node, name: str, patience: float) -> Entity:
    found: list[Entity] = node.wait_for(lambda graph: graph.find(name, ("MP",)), patience)
    if not found:
        there = ", ".join(node.graph.topics()) or "none"
        raise RosError(f"{name}: no node publishes it in domain {node.domain}; topics there: {there}")
    return found[0]


def _types_for(publisher: Entity, distribution: str | None, folders: list[Path]) -> Types:
    """Types of the given distribution, or of the first one that has the publisher's type with the same hash.

    Raises:
        UnknownType: None has it.
    """
    # Only humble has no hashes.
    likely = [name for name in DISTRIBUTIONS if (name == "humble") == (publisher.type_hash == NOT_HASHED)]
    for name in [distribution] if distribution else likely:
        types = Types(name, folders)
        if types.has(publisher.type_name) and types.hash_of(publisher.type_name) == publisher.type_hash:
            return types
    raise UnknownType(
        f"{publisher.name} is of {publisher.type_name} with hash {publisher.type_hash}, which "
        f"{distribution or 'no distribution'} has: give its definition with --interfaces DIR"
    )


@contextmanager
def _joined(router: str, domain: int) -> Iterator[Node]:
    """A node that has discovered the other nodes of the network."""
    with Node(f"navloom_{os.getpid()}", router=router, domain=domain) as node:
        # Graphs arrive piece by piece; a list at once would lack most nodes.
        node.settle()
        yield node


@contextmanager
def _refusals() -> Iterator[None]:
    """Print errors as one line, with the exit code; end quietly on Ctrl-C or a closed pipe."""
    try:
        yield
    except RosError as error:
        typer.echo(printable(f"navloom ros: {error}", kept="\n"), err=True)
        wrong = isinstance(error, (BadDefinition, BadName, UnknownType))
        raise typer.Exit(WRONG if wrong else FAILED) from None
    except BrokenPipeError:  # as when the output is piped to head
        # Or Python complains once more when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        return


def _as_dict(graph: Graph, own_session: str) -> dict[str, list[Any]]:
    others = graph.without(own_session)
    return {
        "nodes": others.nodes(),
        "topics": [_entry(name, listed, "publishers", "subscriptions") for name, listed in others.topics().items()],
        "services": [_entry(name, listed, "servers", "clients") for name, listed in others.services().items()],
        "actions": [_entry(name, listed, "servers", "clients") for name, listed in others.actions().items()],
    }


def _entry(name: str, listed: Listed, providers: str, users: str) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": name, "types": listed.types}
    for words, entities in ((providers, listed.providers), (users, listed.users)):
        entry[words] = [
            {"node": entity.full_node_name, "qos": str(entity.qos), "hash": entity.type_hash} for entity in entities
        ]
    hashes = {one.type_hash for one in (*listed.providers, *listed.users)}
    entry["matches"] = len(hashes) <= 1 and len(listed.types) <= 1
    return entry


def _line(entry: dict[str, Any]) -> str:
    (providers, offered), (users, used) = list(entry.items())[2:4]
    text = f"{entry['name']}  {', '.join(entry['types'])}  {len(offered)} {providers}, {len(used)} {users}"
    qualities = sorted({one["qos"] for one in offered})
    if qualities and providers == "publishers":
        text += f"  ({'; '.join(qualities)})"
    return text if entry["matches"] else f"{text}  TYPES OR HASHES DIFFER: they cannot communicate"


def _text(types: Types, received: Received, most: int | None, as_json: bool) -> str:
    values = types.plain(received.message, most)
    if not as_json:
        return "\n".join([f"--- {received.sequence}", *_lines(values)])
    beside = {"sequence": received.sequence, "source_ns": received.source_ns, "received_ns": received.received_ns}
    return json.dumps({**beside, "message": _finite(values)}, allow_nan=False)


def _lines(values: dict[str, Any], depth: int = 0) -> Iterator[str]:
    for name, value in values.items():
        start = f"{'  ' * depth}{name}:"
        if isinstance(value, dict):
            yield start
            yield from _lines(value, depth + 1)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield start
            for one in value:
                inner = list(_lines(one, depth + 2)) if isinstance(one, dict) else [f"{'  ' * (depth + 2)}{one}"]
                yield f"{'  ' * (depth + 1)}- {inner[0].lstrip()}"
                yield from inner[1:]
        else:
            yield f"{start} {printable(json.dumps(value, ensure_ascii=False))}"


def _finite(value: Any) -> Any:
    """Values for JSON, which has no NaN or infinity: these become text."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
