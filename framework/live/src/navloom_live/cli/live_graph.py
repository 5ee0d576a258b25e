"""The graph of a live robot: its nodes, and the streams that each has received."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer
from navloom.inputs import printable

if TYPE_CHECKING:
    from navloom_live.operating.robot_nodes import Node

__all__ = ["live_edges", "live_nodes", "print_dot", "print_live_graph", "print_nodes"]

__all__ = ["live_edges", "live_nodes", "print_dot", "print_nodes"]


def live_nodes(nodes: Sequence[Node]) -> list[dict[str, Any]]:
    """Every node, also announced and missing ones, in the order of their steps; `state` is that of `navloom list`."""
    from navloom_live.cli.listing import state
    from navloom_live.operating.robot_nodes import missing

    found: list[dict[str, Any]] = []
    for node in nodes:
        said = node.description
        found.append(
            {"role": node.role, "instance": node.instance, "process": node.process, "host": said and said.host,
             "active": said and said.active, "state": state(node), "published": said.published if said else {},
             "carries": said.carries if said else {}}
        )  # fmt: skip
    for gone in missing(nodes):
        found.append(
            {"role": gone.role, "instance": gone.instance, "process": gone.process, "host": gone.host or None,
             "active": None, "state": "missing", "published": {}, "carries": {}}
        )  # fmt: skip
    return found


def live_edges(nodes: Sequence[Node]) -> list[dict[str, Any]]:
    """Every stream into a node, with the number of messages received."""
    from navloom_live.operating.robot_nodes import answering

    return [
        {"from": stream.rpartition("/")[0], "port": stream.rpartition("/")[2],
         "to": f"{node.role}/{node.instance}", "received": counts.received}
        for node in answering(nodes) for stream, counts in node.streams.items()
    ]  # fmt: skip


def print_nodes(nodes: Sequence[Mapping[str, Any]], edges: Sequence[Mapping[str, Any]]) -> None:
    """Print for each node the streams that it has and has not received, and the ports that it publishes."""
    for node in nodes:
        name = f"{node['role']}/{node['instance']}"
        typer.echo(printable(f"{name} ({node['state']}; {_place(node)})"))
        into = [edge for edge in edges if edge["to"] == name]
        for words, is_received in (("receives", True), ("has not received", False)):
            streams = [f"{edge['from']}/{edge['port']}" for edge in into if bool(edge["received"]) is is_received]
            if streams:
                typer.echo(printable(f"  {words} {', '.join(streams)}"))
        if node["published"]:
            ports = ", ".join(_with_type(port, node["carries"]) for port in node["published"])
            typer.echo(printable(f"  publishes {ports}"))


def print_dot(nodes: Sequence[Mapping[str, Any]], edges: Sequence[Mapping[str, Any]]) -> None:
    """Print for Graphviz: a box for each process, missing nodes dashed, streams without messages dotted."""
    typer.echo("digraph navloom {\n  rankdir=LR;")
    processes = dict.fromkeys((node["process"], node["host"]) for node in nodes)
    for number, (process, host) in enumerate(processes):
        typer.echo(f'  subgraph cluster_{number} {{\n    label="{process}{f" on {host}" if host else ""}";')
        for node in nodes:
            if (node["process"], node["host"]) == (process, host):
                style = "" if node["active"] is not None else " [style=dashed]"
                typer.echo(f'    "{node["role"]}/{node["instance"]}"{style};')
        typer.echo("  }")
    for edge in edges:
        style = "" if edge["received"] else ", style=dotted"
        typer.echo(f'  "{edge["from"]}" -> "{edge["to"]}" [label="{edge["port"]}"{style}];')
    typer.echo("}")


def _with_type(port: str, carries: Mapping[str, str]) -> str:
    schema = carries.get(port, "").partition("/")[0].removeprefix("navloom.")
    return f"{port} ({schema})" if schema else port


def _place(node: Mapping[str, Any]) -> str:
    host = f" on {node['host']}" if node["host"] else ""
    return f"process {node['process']}{host}"


def print_live_graph(robot: Any, as_json: bool, dot: bool) -> None:
    """Print the nodes, the ports that each publishes, and the streams that it has received."""
    from navloom.cli.output import print_json

    from navloom_live.operating.robot_nodes import present

    with robot.look() as client:
        found = present(client)
    nodes, edges = live_nodes(found), live_edges(found)
    if as_json:
        print_json({"nodes": nodes, "edges": edges})
    elif dot:
        print_dot(nodes, edges)
    else:
        print_nodes(nodes, edges)
