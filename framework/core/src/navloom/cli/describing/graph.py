"""`navloom graph`: the connections between nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from navloom.cli.options import AsJson, Changes, PluginFiles, RobotOptions
from navloom.installed import config_help
from navloom.parts import part

__all__ = ["graph"]


def graph(
    config: Annotated[
        str | None, typer.Argument(metavar="[CONFIG]", help=f"{config_help()} Without one, of a live robot.")
    ] = None,
    set_: Changes = None,
    plugin: PluginFiles = None,
    as_json: AsJson = False,
    dot: Annotated[bool, typer.Option("--dot", help="Print the graph for Graphviz.")] = False,
    *,
    robot: RobotOptions,
) -> None:
    """Print the nodes in the order they step, and their inputs.

    A ~ marks an input from the previous tick.
    """
    from navloom.config import ConfigError

    if config is None:
        if set_:
            raise ConfigError(f"--set {set_[0]}: it changes a config; name one, as `navloom graph paper --set …`")
        part("navloom_live.cli.live_graph", "the graph of a live robot").print_live_graph(robot, as_json, dot)
        return
    if option := robot.first_given():
        raise ConfigError(f"{option} is for a live robot, and {config} is a config; leave one of them out")
    _config_graph(config, set_ or (), as_json, dot)


def _config_graph(config: str, changes: Sequence[str], as_json: bool, dot: bool) -> None:
    """Print the connections that a config defines."""
    from navloom.cli.output import print_json
    from navloom.config import load_config
    from navloom.engine.build import assemble
    from navloom.engine.node_graph import edges

    system = assemble(load_config(config, changes))
    wires = edges(system.specs)
    names = {spec.role: [name for role, name in system.parts if role == spec.role] or ["main"] for spec in system.specs}
    if as_json:
        print_json(
            {
                "nodes": [
                    {"role": spec.role, "instances": names[spec.role], "publishes": list(spec.outputs),
                     "carries": {port.name: _carried(port) for port in spec.ports}}
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
            typer.echo(f"  reads {', '.join(dict.fromkeys(map(str, spec.inputs))) or 'nothing'}")
            typer.echo(f"  publishes {', '.join(f'{port.name} ({_carried(port)})' for port in spec.ports)}")


def _carried(port: Any) -> str:
    """Schema name of a port's message; the framework's own without the package."""
    return str(port.carries.schema_name).removeprefix("navloom.") or "any message"
