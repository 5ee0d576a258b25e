"""`navloom graph`: who reads what from whom."""

from __future__ import annotations

from typing import Annotated

import typer

from navloom.cli.live_options import AsJson, Connect, Insecure, Keys, RobotName

__all__ = ["graph"]


def graph(
    config: Annotated[
        str | None, typer.Argument(metavar="[CONFIG]", help="Path or shipped name; without one, of a live robot.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="A.B=V", help="Change one value of the config; repeats.")
    ] = None,
    as_json: AsJson = False,
    dot: Annotated[bool, typer.Option("--dot", help="Print the graph for Graphviz.")] = False,
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
) -> None:
    """Print the nodes in the order they step and what each reads; ~ marks what is read of the previous tick."""
    from navloom.cli.output import print_json
    from navloom.config import load_config
    from navloom.dataflow.graph import edges
    from navloom.runtime.build import assemble

    if config is None:
        _live_graph(robot, connect, keys, insecure, as_json, dot)
        return
    system = assemble(load_config(config, set_ or ()))
    wires = edges(system.specs)
    names = {spec.role: [name for role, name in system.parts if role == spec.role] or ["main"] for spec in system.specs}
    if as_json:
        print_json(
            {
                "nodes": [
                    {"role": spec.role, "instances": names[spec.role], "publishes": list(spec.outputs)}
                    for spec in system.specs
                ],
                "edges": [
                    {"from": source, "port": given.port, "to": target, "delayed": given.delayed,
                     "triggers": given.triggers}
                    for source, target, given in wires
                ],
            }
        )  # fmt: skip
    elif dot:
        typer.echo("digraph navloom {\n  rankdir=LR;")
        for source, target, given in wires:
            style = f' style=dashed, label="~{given.port}"' if given.delayed else f' label="{given.port}"'
            typer.echo(f"  {source} -> {target} [{style.strip()}];")
        typer.echo("}")
    else:
        for spec in system.specs:
            typer.echo(f"{spec.role} ({', '.join(names[spec.role])})")
            typer.echo(f"  reads {', '.join(map(str, spec.inputs)) or 'nothing'}")
            typer.echo(f"  publishes {', '.join(spec.outputs)}")


def _live_graph(
    robot: str | None, connect: str | None, keys: str | None, insecure: bool, as_json: bool, dot: bool
) -> None:
    """Who is there, what each publishes, and whose messages it has received."""
    from navloom.cli.output import print_json
    from navloom.runtime.joining import join
    from navloom.runtime.looking import listing

    with join(robot, connect, keys, "viewer", insecure) as client:
        nodes = [node for node in listing(client) if node["answers"]]
    wires = [
        {"from": "/".join(stream.split("/")[:2]), "port": stream.split("/")[2], "to": f"{n['role']}/{n['instance']}",
         "received": counts["received"]}
        for n in nodes for stream, counts in n["streams"].items()
    ]  # fmt: skip
    if as_json:
        shown = ("role", "instance", "process", "host", "active", "published")
        print_json({"nodes": [{key: node[key] for key in shown} for node in nodes], "edges": wires})
    elif dot:
        typer.echo("digraph navloom {\n  rankdir=LR;")
        for wire in wires:
            style = "" if wire["received"] else " style=dotted,"
            typer.echo(f'  "{wire["from"]}" -> "{wire["to"]}" [{style.strip()} label="{wire["port"]}"];')
        typer.echo("}")
    else:
        for node in nodes:
            name = f"{node['role']}/{node['instance']}"
            typer.echo(f"{name} ({node['process']} on {node['host']}{'' if node['active'] else ', not in charge'})")
            reads = [
                f"{w['from']}/{w['port']}{'' if w['received'] else ' (nothing yet)'}" for w in wires if w["to"] == name
            ]
            typer.echo(f"  reads {', '.join(reads) or 'nothing'}")
            typer.echo(f"  publishes {', '.join(node['published'])}")
