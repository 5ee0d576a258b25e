"""A robot under systemd: a unit for each of its processes, and notifications to the service manager."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from navloom.config import ConfigError
from navloom.config.tables import LiveTable
from navloom.engine.system import System

from navloom_live.hosting.network import Network
from navloom_live.hosting.node_main import CONTROL_PRIORITY
from navloom_live.hosting.node_process import longest_step
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.node_placement import goes_first, spread
from navloom_live.timing import SERVICE_STOP_LIMIT, START_LIMIT

__all__ = ["UnitCommand", "notify", "units"]

SERVICE_RESTART_WAIT = 0.5
"""Wait before a process is restarted, s."""
MEMORY, TASKS = "4G", 512
"""Most memory of a process, and its most threads and child processes."""
RUNTIME = "navloom"
"""Folder below /run that the processes of a host share."""


def notify(state: str) -> None:
    """Send a state to the service manager, if there is one: READY=1, WATCHDOG=1, STOPPING=1 (sd_notify protocol)."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    if address.startswith("@"):  # an abstract socket
        address = "\0" + address[1:]
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
        # A service manager that does not read must not stop a node.
        line.setblocking(False)
        line.sendto(state.encode(), address)


@dataclass(frozen=True)
class UnitCommand:
    """The command that the units run.

    Attributes:
        navloom: Path of the command.
        config: Path of the config, or a shipped name.
        folder: Working directory, for relative paths in the config.
        user: User that runs it.
        insecure: Plain TCP to other hosts is allowed.
    """

    navloom: Path
    config: str
    folder: Path
    user: str
    insecure: bool = False


def units(system: System, network: Network, host: str | None, command: UnitCommand) -> dict[str, str]:
    """Text of each unit by file name: the robot's processes on a host, the router if this host starts it, and the
    target that starts them all.

    Args:
        system, network: The robot.
        host: Host of the config's `[live.hosts]`; None for all.
        command: The command that they run.

    Raises:
        ConfigError: A process has the router's name, or nothing runs on this host.
    """
    robot, stem = f"{network.realm}/{network.robot}", f"navloom-{network.realm}-{network.robot}"
    live = system.config.live
    shares = spread(system.config, all_sources(system), host)
    services: dict[str, _Service] = {}
    if network.starts_router:
        if "router" in shares:
            raise ConfigError("live.processes.router: that is the name of the router's own unit; choose another")
        words = ["router", network.router, "--robot", robot]
        keys = ["--keys", str(network.folder)] if network.folder is not None else []
        services["router"] = _Service("router", (*words, *keys), (), live.hang_timeout, is_control=True)
    for process, sources in shares.items():
        own = ("node", command.config, process, *(["--here"] if network.router else []))
        services[process] = _node(process, sources, _before(process, shares, network.starts_router), own, live)
    if not services:
        raise ConfigError(f"live.hosts.{host}: no process runs on this host, so there are no units")
    made = {f"{stem}-{name}.service": _text(service, robot, stem, command, live) for name, service in services.items()}
    target = f"[Unit]\nDescription=Robot {robot}\nWants={' '.join(made)}\n\n[Install]\nWantedBy=multi-user.target\n"
    return {**made, f"{stem}.target": target}


@dataclass(frozen=True)
class _Service:
    """The part of a unit that differs between the units of a robot.

    Attributes:
        what: Text for its description.
        words: Arguments of the navloom command.
        after: Processes that start before it, and so end after it.
        watchdog: Longest silence of its main loop, s.
        is_control: It has priority over processes that only compute.
    """

    what: str
    words: tuple[str, ...]
    after: tuple[str, ...]
    watchdog: float
    is_control: bool


def _before(process: str, shares: Mapping[str, tuple[Source, ...]], has_router: bool) -> tuple[str, ...]:
    """Units of this host that start before the unit of a process: those of router, platform and gate."""

    def rank(name: str) -> int:
        roles = {role for role, _ in shares[name]}
        # Units end in the reverse order: the gate can stop the robot while the platform still drives it.
        return 0 if "platform" in roles else 1 if "gate" in roles else 2

    first = ("router",) if has_router else ()
    return (*first, *(name for name in shares if rank(name) < rank(process)))


def _node(
    process: str, sources: tuple[Source, ...], after: tuple[str, ...], words: tuple[str, ...], live: LiveTable
) -> _Service:
    roles = dict.fromkeys(role for role, _ in sources)
    watchdog = max(longest_step(role, live.hang_timeout) for role in roles)
    return _Service(f"{process} ({', '.join(roles)})", words, after, watchdog, goes_first(roles))


def _text(service: _Service, robot: str, stem: str, command: UnitCommand, live: LiveTable) -> str:
    words = [str(command.navloom), *service.words, *(["--insecure"] if command.insecure else [])]
    after = ["network-online.target", *(f"{stem}-{name}.service" for name in service.after)]
    lines = [
        "[Unit]",
        f"Description={_plain(f'Robot {robot}: {service.what}')}",
        f"PartOf={stem}.target",
        "Wants=network-online.target",
        f"After={' '.join(after)}",
        f"StartLimitIntervalSec={live.restart_window:g}",
        # systemd counts the first start, too.
        f"StartLimitBurst={live.restart_limit + 1}",
        "",
        "[Service]",
        "Type=notify",
        f"ExecStart={' '.join(map(_word, words))}",
        f"WorkingDirectory={_plain(str(command.folder))}",
        f"User={command.user}",
        f"RuntimeDirectory={RUNTIME}",
        "RuntimeDirectoryMode=0700",
        # Each unit would otherwise remove the folder that it shares with the others.
        "RuntimeDirectoryPreserve=yes",
        f"Environment=NAVLOOM_RUNTIME_DIR=/run/{RUNTIME}",
        "Restart=always",
        f"RestartSec={SERVICE_RESTART_WAIT:g}",
        f"WatchdogSec={service.watchdog:g}",
        f"TimeoutStartSec={START_LIMIT:g}",
        f"TimeoutStopSec={SERVICE_STOP_LIMIT:g}",
        *([f"Nice={CONTROL_PRIORITY}"] if service.is_control else []),
        # A node that grows is ended and restarted alone, before the system chooses another process.
        f"MemoryMax={MEMORY}",
        f"TasksMax={TASKS}",
        "NoNewPrivileges=yes",
        "ProtectSystem=full",
    ]
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """A value escaped so that systemd expands nothing in it."""
    return text.replace("%", "%%")


def _word(text: str) -> str:
    """A word of a command line as systemd reads it."""
    quoted = _plain(text).replace("\\", "\\\\").replace('"', '\\"').replace("$", "$$")
    return f'"{quoted}"' if any(character in text for character in " \t'\"\\;") or not text else quoted
