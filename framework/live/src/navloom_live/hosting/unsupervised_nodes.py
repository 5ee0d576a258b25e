"""Nodes that are started one by one without a supervisor: what each process runs, and how it finds the others."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from navloom.config import ConfigError
from navloom.engine.system import System
from navloom.plugins.registry import nearest

from navloom_live.hosting.network import Network, network_of
from navloom_live.hosting.node_claims import Claims
from navloom_live.hosting.node_process import Share
from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder, Running
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.node_placement import spread
from navloom_live.timing import DEAD_TOKEN_WAIT
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.links import peer_link
from navloom_live.transport.tool_sessions import joined
from navloom_live.transport.zenoh_bus import BusError

__all__ = ["chosen_sources", "share_by_hand"]

REPRESENT_CHECK_INTERVAL = 0.5
"""Interval of checking whether another process represents the robot, s."""


def chosen_sources(system: System, names: Sequence[str]) -> tuple[Source, ...]:
    """Nodes by role, role.instance or name of a process. Raises ConfigError for a name that is none of them."""
    config = system.config
    # Operators are clients; no process runs one.
    everybody = [source for source in all_sources(system) if source[0] != "operator"]
    processes = spread(config, everybody, None)
    found: list[Source] = []
    for name in names:
        role, dot, instance = name.partition(".")
        if name in processes:
            fitting = list(processes[name])
        else:
            fitting = [source for source in everybody if source[0] == role and (not dot or source[1] == instance)]
        if not fitting:
            known = [*processes, *dict.fromkeys(role for role, _ in everybody)]
            raise ConfigError(f"node {name!r}: no such node or process{nearest(name, known)}")
        found += [source for source in fitting if source not in found]
    return tuple(found)


def _refuse_doubles(network: Network, sources: Sequence[Source]) -> None:
    """Refuse nodes that already run: the messages of both would mix. Raises DirectoryError."""
    link = network.tool()
    if not link.connect:
        return
    keys = KeySpace(network.realm, network.robot)
    with suppress(BusError), joined(link, 0.0) as bus:  # without a router yet, no other node can be seen
        began = time.monotonic()
        # For a while: tokens of a node that has just died stay until its lease is over.
        while there := [source for source in sources if bus.alive(keys.alive(*source, "*"))]:
            if time.monotonic() - began > DEAD_TOKEN_WAIT:
                raise DirectoryError(
                    f"{', '.join(' '.join(source) for source in there)} of robot {keys.prefix}: runs already, and "
                    "two would both publish; `navloom list` shows where it runs: end that one first"
                )
            time.sleep(0.1)


def _host_of(system: System, names: Sequence[str]) -> str | None:
    """Host of a process by the config; None where the config names no hosts. Raises ConfigError."""
    live = system.config.live
    if len(names) != 1 or names[0] not in live.processes:
        known = ", ".join(live.processes)
        raise ConfigError(f"node {' '.join(names)}: --here takes one process of live.processes: {known}")
    hosts = [host for host, processes in live.hosts.items() if names[0] in processes]
    if live.hosts and not hosts:
        raise ConfigError(
            f"node {names[0]}: live.hosts has it on no host, so --here cannot tell which processes run with it"
        )
    return hosts[0] if hosts else None


@contextmanager
def share_by_hand(
    system: System,
    names: Sequence[str],
    connect: str | None,
    keys: str | None,
    insecure: bool,
    here: bool = False,
    say: Callable[[str], None] = lambda text: None,
) -> Iterator[Share]:
    """The share of a process without a supervisor, for as long as it runs. Its socket is named after its first node.

    Args:
        system, names: The robot, and its nodes to run.
        connect: Endpoint of its router; None for the config's.
        keys: Folder of certificates, or a certificate in it; None for the config's.
        insecure: Plain TCP to another host is allowed.
        here: `names` is one process, and this host runs the other processes that the config places with it: if there
            is a router, these connect by sockets in addition.
        say: Receives a message if another process runs one of the nodes too.

    Raises:
        ConfigError: There is no such node; DirectoryError: it runs already; LinkError: it cannot join the network.
    """
    sources = chosen_sources(system, names)
    host = _host_of(system, names) if here else None
    network = network_of(system.config, host, insecure)
    if connect is not None:
        network = replace(network, router=connect)
    if keys is not None:
        network = replace(network, keys=Path(keys))
    _refuse_doubles(network, sources)
    claims = Claims(KeySpace(network.realm, network.robot), sources, say)
    folder = RobotFolder(network.realm, network.robot)
    folder.make()
    if network.router and here:
        (name,) = names
        link = network.links(folder, spread(system.config, all_sources(system), host))[name]
        ends = link.connect
    elif network.router:
        # Cut, as a path of a socket has about a hundred characters at most.
        name = "-".join(dict.fromkeys(role for role, _ in sources))[:24] + f"-{os.getpid()}"
        link = network.alone()
        ends = link.connect
    else:
        name = ".".join(sources[0])
        # A node started at the same moment has no socket yet: every possible name is tried until it exists.
        possible = [folder.socket(".".join(source)) for source in all_sources(system) if source not in sources]
        link = peer_link(
            folder.socket(name), (*folder.sockets(), *possible), network.realm, network.robot, network.shared_memory
        )
        ends = link.listen
    shown = "" if network.folder is None else str(network.folder.absolute())
    running = Running(
        network.realm, network.robot, os.getpid(), ends, bool(network.router), system.loaded.name, False, shown, False
    )
    with claims, _standing(RobotFolder(network.realm, network.robot, bool(network.router)), running):
        claims.take_here()
        if network.router:
            claims.take_on(network.alone(), now=True)
        try:
            yield Share(name, sources, link, False, time.monotonic_ns())
        finally:
            with suppress(OSError):
                (folder.path / f"{name}.sock").unlink()


@contextmanager
def _standing(folder: RobotFolder, running: Running) -> Iterator[None]:
    """Let one of the unsupervised processes represent the robot on this host, so that commands find it.

    When that process ends, another one takes over within a moment. If the robot has a supervisor on this host, no
    process represents it, except behind a router; there the supervisor still takes precedence for commands.
    """
    ended = threading.Event()
    holder = folder.read()
    if holder is not None and holder.supervised and not running.via_router:
        yield
        return

    def stand() -> None:
        # The lock is free as soon as its holder ends, whatever ended it.
        while not folder.lock():
            if ended.wait(REPRESENT_CHECK_INTERVAL):
                return
        with suppress(OSError):  # full disk: commands need --connect then
            folder.write(running)

    thread = threading.Thread(target=stand, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        if folder.is_held:
            folder.leave()
