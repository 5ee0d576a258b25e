"""`navloom config`: the values in effect, a check, and what a config may contain."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from typing import Annotated, Any

import typer

from navloom.cli.command import App
from navloom.cli.options import AsJson, ConfigOptions

__all__ = ["app"]

app = App(help="Show, check and describe configs.", no_args_is_help=True)


@app.command()
def show(
    given: ConfigOptions,
    as_json: AsJson = False,
    toml: Annotated[
        bool, typer.Option("--toml", help="Print the file itself, to begin from; comments tell what is derived.")
    ] = False,
) -> None:
    """Print every value in effect and its origin.

    The origin is the default, the file, a method of the file, --set, or what a value is derived from.
    """
    if toml:
        _print_file(given, as_json)
        return
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


def _print_file(given: ConfigOptions, as_json: bool) -> None:
    """Print the text of a config, and what is derived. Raises ConfigError for options that change values."""
    from navloom.config import ConfigError
    from navloom.config.loader import text_of
    from navloom.engine.build import assemble
    from navloom.engine.effective_config import holding

    asked = {"--json": as_json, "--method": given.method, "--set": given.set_}
    if wrong := [option for option, value in asked.items() if value]:
        raise ConfigError(f"--toml with {' and '.join(wrong)}: it prints the file as it is; leave one of them out")
    typer.echo(text_of(given.config), nl=False)
    for place, value, source in holding(assemble(given.load())):
        if "derived from" in source:
            typer.echo(f"# {place} = {as_toml(value)}: {source}")


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

    It checks plugins, parameters, world and wiring, also with each method of the config.
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
        if not given.method:
            _check_methods(given, [table.name for table in loaded.config.method])
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


def _check_methods(given: ConfigOptions, names: list[str]) -> None:
    """Check each method as a study would run it. Raises ConfigError with the problems of all."""
    from navloom.config import ConfigError, load_config
    from navloom.config.config_errors import Gathered
    from navloom.config.config_methods import ALONE
    from navloom.engine.build import assemble
    from navloom.engine.plugin_factory import try_plugins

    problems = Gathered()
    for name in names:
        with problems.gather():
            try_plugins(assemble(load_config(given.config, (*(given.set_ or ()), *ALONE), method=name)))
    problems.refuse(ConfigError)


@app.command()
def schema() -> None:
    """Print the JSON schema of a config.

    `navloom plugins ROLE.NAME` prints a plugin's own parameters.
    """
    from navloom.cli.output import print_json
    from navloom.config import Config

    print_json(Config.model_json_schema())
