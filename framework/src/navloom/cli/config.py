"""`navloom config`: what holds, whether it fits, and what a config may contain."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from navloom.installed import config_help

__all__ = ["ConfigName", "app"]

app = typer.Typer(help="Show, check and describe configs.", no_args_is_help=True)

ConfigName = Annotated[str, typer.Argument(metavar="CONFIG", help=config_help())]
Changes = Annotated[list[str] | None, typer.Option("--set", metavar="A.B=V", help="Change one value; repeats.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


@app.command()
def show(config: ConfigName, set_: Changes = None, as_json: AsJson = False) -> None:
    """Every value that holds and where it came from: default, file or --set."""
    from navloom.cli.output import print_json, print_table
    from navloom.config import load_config
    from navloom.config.loader import leaves
    from navloom.runtime.build import assemble

    loaded = load_config(config, set_ or ())
    system = assemble(loaded)
    tree: dict[str, Any] = loaded.config.model_dump(mode="json")
    for part in system.parts.values():
        params = part.params.model_dump(mode="json")
        if "." in part.place:
            number = int(part.place.rsplit(".", 1)[1])
            tree["alternative"][number].update(params)
        else:
            tree[part.place].update(params)
    rows = [(place, value, loaded.sources.get(place, "default")) for place, value in leaves(tree)]
    if as_json:
        print_json(
            {
                "config_sha256": loaded.sha256(),
                "values": [{"place": p, "value": v, "source": s} for p, v, s in rows],
                "dropped": list(loaded.dropped),
            }
        )
        return
    print_table(("place", "value", "from"), rows)
    for place in loaded.dropped:
        typer.echo(f"dropped: {place}, a parameter of the plugin that --set replaced")


@app.command()
def check(config: ConfigName, set_: Changes = None, as_json: AsJson = False) -> None:
    """Check a config, its plugins' parameters, the world and the wiring, without running it."""
    from navloom.cli.output import print_json
    from navloom.config import load_config
    from navloom.runtime.build import assemble
    from navloom.runtime.checks import check_task
    from navloom.runtime.network import network_of

    loaded = load_config(config, set_ or ())
    system = assemble(loaded)
    check_task(system)
    network = network_of(loaded.config, loaded.config.live.router_host, insecure=True)
    if network.keys is None:  # certificates lie on the robot's hosts, which this one need not be
        network.check()
    if as_json:
        print_json({"ok": True, "config_sha256": loaded.sha256(), "nodes": [spec.role for spec in system.specs]})
    else:
        typer.echo(f"{config}: fits; {len(system.parts)} plugins, {len(system.sensors)} sensors")


@app.command()
def schema() -> None:
    """JSON schema of a config; a role's own parameters are those of `navloom plugins ROLE.NAME`."""
    from navloom.cli.output import print_json
    from navloom.config import Config

    print_json(Config.model_json_schema())
