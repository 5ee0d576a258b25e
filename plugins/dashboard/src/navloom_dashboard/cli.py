"""`navloom dashboard`: operate live robots from a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from navloom.cli import say_so
from navloom.config import ConfigError

__all__ = ["dashboard"]


def dashboard(
    robots: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ROBOT]…", help="Which robots, as lab/r1 or r1; default: all that are up on this host."
        ),
    ] = None,
    bind: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address to listen on; beyond loopback only with --tls.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="TCP port; 0 for a free one.")] = 8787,
    name: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Also answer to this host name; repeats.")
    ] = None,
    tls: Annotated[
        Path | None,
        typer.Option(metavar="CERT.pem", help="Serve over TLS with this certificate of the robot, as keys/router.pem."),
    ] = None,
    certificates: Annotated[
        bool, typer.Option("--certificates", help="Browsers may log in with a certificate of the robot; with --tls.")
    ] = False,
    recordings: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of recordings that are made from the page.")
    ] = Path("recordings"),
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Router of a robot elsewhere, as tls/10.0.0.1:7447.")
    ] = None,
    keys: Annotated[
        str | None, typer.Option(metavar="DIR", help="Folder of certificates, or one in it, as DIR/viewer.pem.")
    ] = None,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Plain TCP and HTTP beyond this host, in a closed test network only.")
    ] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """Operate live robots from a browser, until Ctrl-C.

    It prints two addresses: one for operators, one for viewers.
    """
    from navloom_live import WebServer, guarded, is_loopback

    from navloom_dashboard.app import Dashboard
    from navloom_dashboard.robot_link import Where

    if not is_loopback(bind) and tls is None and not insecure:
        raise ConfigError(
            f"--bind {bind}: anyone on the network could read the tokens; add --tls keys/router.pem, or, in a closed "
            "test network, --insecure"
        )
    if certificates and tls is None:
        raise ConfigError("--certificates: browsers show theirs over TLS only; add --tls keys/router.pem")
    if connect is not None and len(robots or ()) != 1:
        raise ConfigError("--connect: name the robot, as `navloom dashboard lab/r1 --connect tls/10.0.0.1:7447`")

    def find() -> dict[str, Any]:
        if connect is not None:
            return {robots[0]: Where(robots[0], connect, keys, insecure)}  # type: ignore[index]
        return {one: Where(one, None, keys, insecure) for one in _up(robots or [])}

    server = WebServer((bind, port), tls, websockets=True, certificates=certificates)
    made = Dashboard(find, recordings, f"navloom-{server.port}", tls is not None, server.kind_of)
    names = {*(name or ()), *server.names}
    url = f"{server.url}/#token="
    say_so(f"operators: {url}{made.sessions.tokens['operate']}")
    say_so(f"viewers: {url}{made.sessions.tokens['view']}")
    if open_:
        _open(f"{url}{made.sessions.tokens['operate']}")
    server.run(guarded(made.app, names))


def _up(wanted: list[str]) -> list[str]:
    """Robots of this user that are up on this host; of `wanted`, if any are named."""
    from navloom_live import robots

    found = [(f"{one.realm}/{one.robot}", one.robot) for one in robots()]
    return [full for full, short in found if not wanted or full in wanted or short in wanted]


def _open(url: str) -> None:
    """Open a page if this host has a display."""
    import webbrowser

    webbrowser.open(url)
