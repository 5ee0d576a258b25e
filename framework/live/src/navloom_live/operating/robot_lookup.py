"""Finds a running robot and joins its network."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from navloom.misspelt import close_to

from navloom_live.hosting.node_claims import elsewhere
from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder, Running, robots
from navloom_live.operating.client import Client
from navloom_live.timing import FOLLOW_INTERVAL
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.links import Link, certificate, credential_files
from navloom_live.transport.tool_sessions import expiring, joined
from navloom_live.transport.zenoh_bus import Bus, BusError

__all__ = ["ANY", "find_robot", "join", "split_name"]

ANY = "operator or viewer"
"""Identity of a tool that offers what its certificate allows: an operator's if the folder has one, else a viewer's."""
SESSION_CLOSE_WAIT = 2.0
"""Longest wait for a session that is being opened when the tool leaves, s: longer than opening one takes
(`timing.GATHER_WAIT`)."""
LOG = logging.getLogger("navloom_live.operating")


def find_robot(robot: str | None) -> Running:
    """The running robot REALM/NAME, or NAME if that is unique; without a name, the only one that is up.

    Raises:
        DirectoryError: No robot is up, none has that name, or several match.
    """
    found = list(robots())
    names = [f"{one.realm}/{one.robot}" for one in found]
    if robot is None:
        if len(found) == 1:
            return found[0]
        if not found:
            if others := elsewhere():
                raise DirectoryError(_in_other_folders(others))
            raise DirectoryError(
                "no robot of this user is up on this host: start one with `navloom up CONFIG`, "
                "or reach one elsewhere with --connect ENDPOINT"
            )
        raise DirectoryError(f"several robots are up: {', '.join(names)}; choose one with --robot")
    matches = [one for one, name in zip(found, names, strict=True) if robot in (name, one.robot)]
    if len(matches) == 1:
        return matches[0]
    if matches:
        full = [f"{one.realm}/{one.robot}" for one in matches]
        raise DirectoryError(f"--robot {robot}: several robots of that name are up: {', '.join(full)}; add the realm")
    others = {name: folder for name, folder in elsewhere().items() if robot in (name, name.partition("/")[2])}
    if others:
        raise DirectoryError(_in_other_folders(others))
    up = f"; up are {', '.join(names)}" if names else "; none is up"
    raise DirectoryError(f"--robot {robot}: it is not up on this host{up}{close_to(robot, names)}")


def _in_other_folders(others: Mapping[str, Path]) -> str:
    """Message that robots are up, but were started by a shell with another runtime folder."""
    each = [f"robot {name} is up in the runtime folder {folder}" for name, folder in others.items()]
    remedy = f"set NAVLOOM_RUNTIME_DIR={next(iter(others.values()))} to reach it"
    return f"{'; '.join(each)}, which this shell does not use: {remedy}"


def split_name(robot: str) -> tuple[str, str]:
    """REALM and NAME of a robot. Raises DirectoryError for an invalid name: a wildcard would address several robots."""
    named = re.fullmatch(r"([A-Za-z0-9_-]+)/([A-Za-z0-9_-]+)", robot)
    if named is None:
        raise DirectoryError(f"--robot {robot}: expected REALM/NAME of letters, digits, - and _, as in lab/r1")
    return named[1], named[2]


def _shown(keys: str | None, identity: str) -> tuple[Path | None, str | None]:
    """Folder and name of the certificate that a tool presents."""
    folder, name = certificate(Path(keys) if keys else None, identity)
    if folder is not None and name == ANY:
        name = next((one for one in ("operator", "viewer") if (folder / f"{one}.pem").exists()), "operator")
    if folder is not None and name == "viewer" and not (folder / "viewer.pem").exists():
        name = "operator" if (folder / "operator.pem").exists() else name
    return folder, name


@contextmanager
def join(
    robot: str | None = None,
    connect: str | None = None,
    keys: str | None = None,
    identity: str = "operator",
    insecure: bool = False,
    say: Callable[[str], None] = LOG.warning,
) -> Iterator[Client]:
    """Join a robot's network as a tool, for the duration of a `with` statement.

    Args:
        robot: REALM/NAME, or NAME if that is unique; None for the only one that is up. With `connect` it must be
            REALM/NAME, and None means lab/r1.
        connect: Endpoint of a router on another host; None searches this host.
        keys: Folder of certificates, or one file in it; None takes those that the robot was started with.
        identity: Name of the certificate if `keys` names none, or ANY. An operator's may replace a viewer's.
        insecure: Plain TCP to another host was requested explicitly.
        say: Receives warnings about certificates that expire soon.

    Raises:
        DirectoryError: There is no such robot; LinkError, BusError: its network cannot be joined.
    """
    home: RobotFolder | None = None
    if connect is not None:
        realm, name = split_name(robot or "lab/r1")
        link = Link("client", (), (connect,), *_shown(keys, identity), insecure, realm, name)
    else:
        running = find_robot(robot)
        realm, name = running.realm, running.robot
        home = RobotFolder(realm, name)
        if running.via_router:
            shown = _shown(keys or running.keys, identity)
            link = Link("client", (), running.endpoints, *shown, insecure, realm, name)
        else:
            # A restarting process has no socket yet; the session retries its endpoint until it is there. Peers do not
            # forward messages, so a tool without a link to the process would receive nothing from it.
            sockets = sorted({*RobotFolder(realm, name).sockets(), *running.endpoints})
            link = Link("peer", (), tuple(sockets), realm=realm, robot=name)
    for warning in expiring(link.credentials):
        say(warning)
    with joined(link) as bus, _following(bus, home, link):
        yield Client(bus, KeySpace(realm, name), home, _may_operate(link))


def _may_operate(link: Link) -> bool:
    """Whether the certificate that a link presents is one that acts; without certificates, every tool may."""
    if link.credentials is None:
        return True
    from navloom_live.transport.certificate_validity import kind_of_certificate  # takes 60 ms to load: only for TLS

    return kind_of_certificate(credential_files(link)[1]) in ("operator", "nodes")


@contextmanager
def _following(bus: Bus, home: RobotFolder | None, link: Link) -> Iterator[None]:
    """Connect to processes that the robot gains while the tool is joined to its sockets."""
    ended = threading.Event()

    def follow(home: RobotFolder) -> None:
        known = set(link.connect)
        while not ended.wait(FOLLOW_INTERVAL):
            running = home.told()
            for end in sorted({*running.endpoints} - known) if running is not None else ():
                known.add(end)
                with suppress(BusError):
                    bus.reach(end)

    thread = threading.Thread(target=follow, args=(home,), name="following", daemon=True)
    if home is not None and link.mode == "peer":
        thread.start()
    try:
        yield
    finally:
        ended.set()
        if thread.is_alive():
            thread.join(SESSION_CLOSE_WAIT)
