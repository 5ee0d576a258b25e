"""`navloom node` and `navloom router`: parts of a robot, run by hand or by a service manager."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer
from navloom.cli.options import Insecure, Keys, RunOptions
from navloom.cli.output import LOG, log_of, say_so

__all__ = ["node", "router"]


def node(
    given: RunOptions,
    names: Annotated[
        list[str], typer.Argument(metavar="NAME…", help="Roles, role.instance, or processes of [live.processes].")
    ],
    connect: Annotated[
        str | None, typer.Option("--connect", metavar="ENDPOINT", help="The robot's router; default: live.router.")
    ] = None,
    keys: Keys = None,
    insecure: Insecure = False,
    here: Annotated[
        bool,
        typer.Option("--here", help="This host runs all processes that the config assigns to it."),
    ] = False,
) -> None:
    """Run chosen nodes of a robot here, until Ctrl-C.

    On one host nodes find each other; nodes of several hosts need a router.
    """
    from navloom.cli.interrupts import ending
    from navloom.engine.build import assemble
    from navloom.engine.task_checks import check_live
    from navloom.kernel_cache import tell_compiled

    from navloom_live.hosting.node_process import NodeProcess, leave
    from navloom_live.hosting.systemd import notify
    from navloom_live.hosting.unsupervised_nodes import share_by_hand
    from navloom_live.timing import START_LIMIT

    system = assemble(given.load())
    check_live(system)
    with (
        ending() as event,
        share_by_hand(system, names, connect, keys, insecure, here, log_of("hosting").warning) as share,
    ):
        _warn(share.link)
        process = NodeProcess(system, share, event)
        sys.setswitchinterval(0.0005)

        def ready() -> None:
            say_so(f"{', '.join(' '.join(source) for source in share.sources)}: ready")
            notify("READY=1")

        tell_compiled(lambda kernels: notify(f"EXTEND_TIMEOUT_USEC={round(START_LIMIT * 1e6)}"))
        process.run(log_of("hosting").info, ready, lambda: notify("WATCHDOG=1"))
        notify("STOPPING=1")
    if process.hung:
        LOG.error(process.hung)
    leave(process)


def router(
    listen: Annotated[str, typer.Argument(metavar="ENDPOINT", help="Endpoint to listen on, as tls/10.0.0.1:7447.")],
    robot: Annotated[str, typer.Option(metavar="REALM/NAME", help="Whose keys its access rules protect.")] = "lab/r1",
    keys: Keys = None,
    insecure: Insecure = False,
) -> None:
    """Run the router that links a robot's hosts, until Ctrl-C."""
    from pathlib import Path

    from navloom.cli.interrupts import ending

    from navloom_live.hosting.router_main import route
    from navloom_live.hosting.systemd import notify
    from navloom_live.operating.robot_lookup import split_name
    from navloom_live.transport.links import Link, certificate

    realm, name = split_name(robot)
    folder, _ = certificate(Path(keys) if keys else None, "router")
    link = Link("router", (listen,), (), folder, "router" if folder else None, insecure, realm, name)
    _warn(link)
    with ending() as event:

        def tell(text: str) -> None:
            log_of("transport").info(f"router of {robot}: {text}")

        def ready() -> None:
            say_so(f"router of {robot}: listening at {listen}")
            notify("READY=1")

        route(link, event, tell, ready, lambda: notify("WATCHDOG=1"))
        notify("STOPPING=1")


def _warn(link: Any) -> None:
    """Warn about certificates that expire soon."""
    from navloom_live.transport.tool_sessions import expiring

    for warning in expiring(link.credentials):
        LOG.warning(warning)
