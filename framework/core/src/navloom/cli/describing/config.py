"""`navloom config`: the values in effect, a check, and what a config may contain."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from typing import Any

import typer

from navloom.cli.command import App
from navloom.cli.options import AsJson, ConfigOptions

__all__ = ["app"]

app = App(help="Show, check and describe configs.", no_args_is_help=True)


@app.command()
def show(given: ConfigOptions, as_json: AsJson = False) -> None:
    """Print every value in effect and its origin.

    The origin is the default, the file or --set.
    """
    from navloom.cli.output import print_json, print_table
    from navloom.engine.build import assemble
    from navloom.engine.effective_config import holding

    loaded = given.load()
    rows = holding(assemble(loaded))
    if as_json:
        print_json(
            {
                "config_sha256": loaded.sha256(),
                "values": [{"place": p, "value": v, "source": s} for p, v, s in rows],
                "dropped": list(loaded.dropped),
            }
        )
        return
    print_table(("place", "value", "from"), [(place, as_toml(value), source) for place, value, source in rows])
    for notice in loaded.notices():
        typer.echo(notice)


def as_toml(value: Any) -> str:
    """A value in the notation of a config or `--set`; `-` if it is not set."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.12g}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(as_toml, value))}]"
    import json

    return json.dumps(value, ensure_ascii=False)


@app.command()
def check(given: ConfigOptions, as_json: AsJson = False) -> None:
    """Check that a config can drive, without running it.

    It checks plugins, parameters, world and wiring.
    """
    from navloom.cli.output import print_json
    from navloom.engine.build import assemble
    from navloom.engine.plugin_factory import try_plugins
    from navloom.engine.task_checks import check_live, check_task, is_real
    from navloom.parts import has_part, part

    loaded = given.load()
    system = assemble(loaded)
    waits = is_real(system) or not loaded.config.navigation.drive
    (check_live if waits else check_task)(system)  # a robot that waits for goals needs none yet
    with redirect_stdout(sys.stderr):  # plugins may print
        try_plugins(system)
    if has_part("navloom_live"):
        network = part("navloom_live.hosting.network").network_of(
            loaded.config, loaded.config.live.router_host, insecure=True
        )
        if network.keys is None:  # certificates are on the robot's hosts, and this host may be another
            network.check()
    if as_json:
        print_json({
            "ok": True,
            "config_sha256": loaded.sha256(),
            "nodes": [spec.role for spec in system.specs],
            "notices": loaded.notices(),
        })  # fmt: skip
    else:
        for notice in loaded.notices():
            typer.echo(notice)
        count = len(system.sensors)
        typer.echo(f"{given.config}: fits; {len(system.parts)} plugins, {count} sensor{'' if count == 1 else 's'}")


@app.command()
def schema() -> None:
    """Print the JSON schema of a config.

    `navloom plugins ROLE.NAME` prints a plugin's own parameters.
    """
    from navloom.cli.output import print_json
    from navloom.config import Config

    print_json(Config.model_json_schema())
