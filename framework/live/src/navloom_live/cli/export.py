"""`navloom export`: a robot's processes for a service manager, or in containers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from navloom.cli.command import App
from navloom.cli.options import AsJson, ConfigName, Insecure

__all__ = ["app"]

app = App(help="Write systemd units or a compose file for a robot.", no_args_is_help=True)


@app.callback()
def export() -> None:
    """Hand a robot over to a service manager, or to containers."""


@app.command()
def systemd(
    config: ConfigName,
    host: Annotated[
        str | None, typer.Option(metavar="NAME", help="Units of this host's share of [live.hosts].")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the units; default: the current one.")] = Path(),
    user: Annotated[str | None, typer.Option(metavar="NAME", help="User that runs the units; default: you.")] = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Write a systemd unit for each process of a robot.

    The units have watchdog and restart; a target starts them all.
    """
    import getpass
    import re
    import sysconfig

    from navloom.cli.output import print_json
    from navloom.config import ConfigError, load_config
    from navloom.engine.build import assemble
    from navloom.engine.task_checks import check_live
    from navloom.files import write_whole

    from navloom_live.hosting.network import network_of
    from navloom_live.hosting.systemd import UnitCommand, units

    loaded = load_config(config)
    _check_host(loaded.config.live.hosts, host)
    if user is not None and not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*|[0-9]+", user):
        raise ConfigError(f"--user {user!r}: expected the name of a user, or a number, as systemd takes it")
    path = Path(config)
    is_file = path.is_file()
    command = UnitCommand(
        Path(sysconfig.get_path("scripts")) / "navloom",
        str(path.absolute()) if is_file else config,
        path.absolute().parent if is_file else Path("/"),
        user or getpass.getuser(),
        insecure,
    )
    system = assemble(loaded)
    check_live(system)
    made = units(system, network_of(loaded.config, host, insecure), host, command)
    out.mkdir(parents=True, exist_ok=True)
    for name, text in made.items():
        write_whole(out / name, text)
    if as_json:
        print_json({"folder": str(out.absolute()), "units": list(made)})
        return
    target = next(name for name in made if name.endswith(".target"))
    files = " ".join(str(out / name) for name in made)
    typer.echo(f"{len(made)} units in {out.absolute()}. To install and start them:")
    typer.echo(f"  sudo cp {files} /etc/systemd/system/")
    typer.echo(f"  sudo systemctl daemon-reload && sudo systemctl enable --now {target}")
    typer.echo(
        f"`systemctl status '{target.removesuffix('.target')}*'` shows them; commands on this host find the robot"
    )
    typer.echo("with NAVLOOM_RUNTIME_DIR=/run/navloom in their environment.")


@app.command()
def compose(
    config: ConfigName,
    host: Annotated[str | None, typer.Option(metavar="NAME", help="Only this host's share of [live.hosts].")] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the files; default: the current one.")] = Path(),
    image: Annotated[str, typer.Option(metavar="NAME", help="Name of the image.")] = "navloom-robot",
    device: Annotated[
        list[str] | None, typer.Option("--device", metavar="PATH", help="Device the robot opens; repeats.")
    ] = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Write a compose file and a container file for a robot.

    The services are the router, the robot, a viewer and the metrics.
    """
    from importlib.metadata import version

    from navloom.cli.output import print_json
    from navloom.config import load_config
    from navloom.files import write_whole
    from navloom.runs.provenance import distributions

    from navloom_live.hosting.compose_files import Compose, compose_files
    from navloom_live.hosting.network import network_of

    loaded = load_config(config)
    _check_host(loaded.config.live.hosts, host)
    path = Path(config) if Path(config).is_file() else None
    installed = {**distributions(loaded.config), "navloom": version("navloom")}
    named = path.name if path is not None else config
    given = Compose(path, named, installed, image, list(loaded.config.live.processes), device or ())
    made = compose_files(network_of(loaded.config, host, insecure), host, given)
    (out / "wheels").mkdir(parents=True, exist_ok=True)
    for name, text in made.items():
        write_whole(out / name, text)
    if as_json:
        print_json({"folder": str(out.absolute()), "files": list(made)})
        return
    typer.echo(f"{', '.join(made)} in {out.absolute()}. Put wheels that are on no index into wheels/. To start them:")
    typer.echo(f"  docker compose -f {out / 'compose.yaml'} up --build --detach")
    typer.echo("Viewer: http://127.0.0.1:9090, metrics: http://127.0.0.1:9464/metrics.")


def _check_host(hosts: Mapping[str, object], host: str | None) -> None:
    """Refuse a host that is not in the config. Raises ConfigError."""
    from navloom.config import ConfigError

    if host is not None and host not in hosts:
        known = f"hosts are {', '.join(hosts)}" if hosts else "the config has no [live.hosts]"
        raise ConfigError(f"--host {host}: {known}")
