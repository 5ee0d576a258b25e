"""Nodes that are started one by one: what each is to do, and how it finds the others."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from navloom.config import ConfigError
from navloom.plugins.registry import nearest
from navloom.runtime.build import System
from navloom.runtime.cell import Source
from navloom.runtime.cells import all_sources
from navloom.runtime.directory import RobotFolder, Running
from navloom.runtime.links import peer_link
from navloom.runtime.network import network_of
from navloom.runtime.node_process import Share
from navloom.runtime.placing import spread

__all__ = ["chosen_sources", "share_by_hand"]


def chosen_sources(system: System, names: Sequence[str]) -> tuple[Source, ...]:
    """Nodes by role, role.instance or name of a process. Raises ConfigError for a name that is none of them."""
    config = system.config
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


@contextmanager
def share_by_hand(
    system: System, names: Sequence[str], connect: str | None, keys: str | None, insecure: bool
) -> Iterator[Share]:
    """The share of a process that nobody supervises, for as long as it runs. Its socket is called as its first node."""
    sources = chosen_sources(system, names)
    network = network_of(system.config, None, insecure)
    if connect is not None:
        network = replace(network, router=connect)
    if keys is not None:
        network = replace(network, keys=Path(keys))
    name = "-".join(dict.fromkeys(role for role, _ in sources))[:24] + f"-{os.getpid()}"
    now = time.monotonic_ns()
    if network.router:
        yield Share(name, sources, network.links(RobotFolder(network.realm, network.robot), [name])[name], False, now)
        return
    folder = RobotFolder(network.realm, network.robot)
    folder.make()
    name = ".".join(sources[0])
    own = folder.socket(name)
    # A process started at the same moment has no socket yet: whatever it will be called is tried until it is there.
    possible = [folder.socket(".".join(source)) for source in all_sources(system) if source not in sources]
    link = peer_link(own, (*folder.sockets(), *possible), network.realm, network.robot)
    is_first = folder.lock()
    if is_first:
        folder.write(Running(network.realm, network.robot, os.getpid(), (own,), False, system.loaded.name, False))
    try:
        yield Share(name, sources, link, False, now)
    finally:
        with suppress(OSError):
            (folder.path / f"{name}.sock").unlink()
        if is_first:
            with suppress(OSError):
                (folder.path / "robot.json").unlink()
            folder.unlock()
