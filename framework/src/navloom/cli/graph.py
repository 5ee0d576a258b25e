"""`navloom graph`: who reads what from whom."""

from __future__ import annotations

from typing import Annotated

import typer

__all__ = ["graph"]


def graph(
    config: Annotated[str, typer.Argument(metavar="CONFIG", help="Path of a config, or a shipped name.")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="A.B=V", help="Change one value of the config; repeats.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    dot: Annotated[bool, typer.Option("--dot", help="Print the graph for Graphviz.")] = False,
) -> None:
    """Print the nodes in the order they step and what each reads; ~ marks what is read of the previous tick."""
    from navloom.cli.output import print_json
    from navloom.config import load_config
    from navloom.dataflow.graph import edges
    from navloom.runtime.build import assemble

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
