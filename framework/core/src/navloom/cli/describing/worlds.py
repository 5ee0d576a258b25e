"""`navloom worlds`: the named worlds and the world schemes."""

from __future__ import annotations

from typing import Annotated

import typer

from navloom.cli.options import PluginFiles

__all__ = ["worlds"]


def worlds(
    plugin: PluginFiles = None, as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False
) -> None:
    """List the named worlds and the schemes for world files."""
    from navloom.cli.output import print_json
    from navloom.plugins.discovery import Discovery

    discovery = Discovery()
    names, schemes = discovery.names("world"), discovery.names("scheme")
    if as_json:
        print_json({"worlds": names, "schemes": schemes})
        return
    typer.echo("worlds: " + ", ".join(names))
    typer.echo(
        "schemes: "
        + ", ".join(f"{scheme}:…" for scheme in schemes)
        + "; and any file that ends in .toml, or .yaml as a map of ROS"
    )
