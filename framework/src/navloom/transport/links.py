"""How a process joins a robot's network, and which ways are refused."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from navloom.inputs.bounds import open_file
from navloom.transport.access import AccessError, limits, read_identities, rules
from navloom.transport.endpoints import Endpoint, LinkError
from navloom.transport.keyspace import LARGEST

__all__ = ["GATHER", "Endpoint", "Link", "LinkError", "Mesh", "credential_files", "peer_link", "settings"]

LEASE = 1000
"""ms of silence until a neighbour counts as gone: a cut cable, a stopped process. A closed socket is seen at once."""
FIND_WAIT, FIND_WAIT_FAR = 2000, 5000
"""ms a client tries to find its router, on this host and on another: with 0.2 s there and back, TLS takes 1.3 s."""
OPEN_WAIT = 5000
"""ms a neighbour may take over its handshake, so that idle strangers cannot hold the places of others for long."""
GATHER = 500
"""ms a peer's opening waits, at most, until it is linked to every peer that is there. It must be: a process that comes
back asks the others what it must not forget, such as a latched stop, as soon as it is open."""
RETRY = 50, 200
"""ms between two calls to a neighbour that is not there, at first and at most: well below GATHER."""
RETRY_GONE = 60_000
"""ms between two calls to a router's predecessor, at most: once it has gone, it does not come back."""
DROP_WAIT = 1000
"""us a droppable message waits for a place in the queue: a twentieth of the shortest usual period."""
DROP_WAIT_FRAGMENTS = 50_000
"""us for the parts of a large droppable message together: one period of 0.05 s; later the next one is newer."""
CLOSE_WAIT = 1_500_000
"""us a message that must arrive waits before the link is given up: longer than LEASE, so that a link to the dead ends
by that, and shorter than live.hang_timeout, so that no writer is taken for hung because its reader is."""
SEND_BUFFER = 65_536
"""bytes in the kernel of a link that leaves the host: priorities end where it begins."""
POOL = 16 * 2**20
"""bytes of shared memory for large messages; taken, and held in memory, when the first one is sent, which takes 15 to
85 ms. Readers keep the pools of processes that have died, so it is no larger than some messages of the largest usual
kind."""
URGENT, REST = "prio=0-3", "prio=4-7"
"""Priorities of the two links to another host: commands and poses do not wait behind a map. A client whose router
started again gets one of them back, which then carries everything: https://github.com/eclipse-zenoh/zenoh/issues/2130
"""

_MODES = ("peer", "client", "router")


@dataclass(frozen=True)
class Link:
    """How a process joins a robot's network.

    Attributes:
        mode: peer, client or router.
        listen, connect: Endpoints, as unixsock-stream//run/x/drive.sock, tcp/127.0.0.1:7447 or tls/10.0.0.1:7447.
        credentials: Folder with ca.pem, NAME.pem and NAME-key.pem, and identities.json for who listens; or None.
        identity: The NAME.
        insecure: Plain TCP beyond this host was asked for.
        realm, robot: Of the keys that the rules of a TLS listener protect.
        peers: Neighbours that opening waits for, as long as GATHER.
        shared_memory: Large messages come by it, see POOL.
        door: Of a router over TLS, the socket of this host where its successor joins it, when certificates change.
        predecessor: Of a router that takes over from another, the door of that one.
        streams: Of the robot, as role/instance/port: all that readers may subscribe to; empty where they are not known.
        mesh: Of a client, how it meets the processes of its own host, not by the router; None where it does not.
    """

    mode: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    credentials: Path | None = None
    identity: str | None = None
    insecure: bool = False
    realm: str = "lab"
    robot: str = "r1"
    peers: int = 0
    shared_memory: bool = False
    door: str = ""
    predecessor: str = ""
    streams: tuple[str, ...] = ()
    mesh: Mesh | None = None

    @property
    def is_spread(self) -> bool:
        """Part of the robot may be behind a router."""
        return self.mode == "client" and not (self.mesh is not None and self.mesh.is_whole)


@dataclass(frozen=True)
class Mesh:
    """Processes of one host that meet over sockets, beside a router.

    Attributes:
        link: Of one of them to the others.
        here: What runs in them, as role/instance, and process/name for themselves.
        is_whole: They are all of the robot.
    """

    link: Link
    here: tuple[str, ...]
    is_whole: bool


def certificate(keys: Path | None, usual: str) -> tuple[Path | None, str | None]:
    """Folder and name of the certificate to show: the one that a file NAME.pem is, else the usual one of a folder."""
    if keys is None:
        return None, None
    return (keys.parent, keys.stem) if keys.suffix == ".pem" else (keys, usual)


def peer_link(own: str, sockets: Iterable[str], realm: str, robot: str, shared_memory: bool = False) -> Link:
    """How a process joins its neighbours on one host. Of two, the one whose socket's name comes later calls the other.

    Were both to call, a process that was stopped and goes on could keep its half of a link that the other has given up,
    and messages would go astray: https://github.com/eclipse-zenoh/zenoh/issues/2806

    Args:
        own: Socket it listens at.
        sockets: Of all.
        realm, robot: Names of the robot.
        shared_memory: Large messages come by it.
    """
    others = sorted({*sockets} - {own})
    earlier = tuple(end for end in others if end < own)
    return Link("peer", (own,), earlier, realm=realm, robot=robot, peers=len(others), shared_memory=shared_memory)


def settings(link: Link, now: datetime | None = None) -> dict[str, Any]:
    """What goes, as JSON, into Zenoh's configuration.

    Args:
        link: How to join.
        now: With its time zone, for the validity of certificates; None for this host's clock.

    Raises:
        LinkError: The link is refused: unsafe, incomplete or not understood.
    """
    if link.mode not in _MODES:
        raise LinkError(f"mode {link.mode!r}: expected {', '.join(_MODES)}")
    listen = [Endpoint.parse(text) for text in link.listen]
    connect = [Endpoint.parse(text) for text in link.connect]
    for end in listen:
        _refuse_listening(link, end)
    for end in connect:
        _refuse_connecting(link, end)
    access = _access(link, listen) if any(end.is_secure for end in listen) else {}
    listen += [Endpoint.parse(link.door)] if link.door else []
    connect += [Endpoint.parse(link.predecessor)] if link.predecessor else []
    ends = [*listen, *connect]
    is_client = link.mode == "client"
    found: dict[str, Any] = {
        "mode": link.mode,
        "scouting": {
            "delay": 0 if link.mode == "router" else GATHER,
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
        },
        "listen": {"endpoints": [end.text for end in listen], "exit_on_failure": True},
        "connect": {
            "endpoints": [_two_links(end) if _leaves(end) else end.text for end in connect],
            "timeout_ms": _find_wait(connect) if is_client else -1,
            "exit_on_failure": is_client,
            "retry": {
                "period_init_ms": RETRY[0],
                "period_max_ms": RETRY_GONE if link.predecessor else RETRY[1],
                "period_increase_factor": 2,
            },
        },
        "timestamping": {"enabled": False},
        "adminspace": {"enabled": False},
        "transport": _transport(link, ends, now or datetime.now(UTC)),
    }
    found |= access
    return found


def _refuse_listening(link: Link, end: Endpoint) -> None:
    if end.is_wildcard and not end.is_secure:
        raise LinkError(
            f"listening at {end.text}: everybody who reaches this host could drive the robot, so every interface is "
            f"listened at over TLS only: make certificates with `navloom keys new DIR` and use tls/…:{end.port}, "
            "or name one address"
        )
    if not end.is_local and not end.is_secure and not link.insecure:
        raise LinkError(f"listening at {end.text}: {_plain(end)}")
    if end.is_socket:
        _refuse_open_folder(end)


def _refuse_connecting(link: Link, end: Endpoint) -> None:
    if end.is_wildcard:
        raise LinkError(f"connecting to {end.text}: it names every interface, expected the address of one host")
    if not end.is_local and not end.is_secure and not link.insecure:
        raise LinkError(f"connecting to {end.text}: {_plain(end)}")


def _plain(end: Endpoint) -> str:
    return (
        f"{end.protocol} beyond this host can be read and forged by others; make certificates with `navloom keys new "
        f"DIR`, use tls/{end.text.partition('/')[2]} and --keys DIR, or, in a closed test network, add --insecure"
    )


def _refuse_open_folder(end: Endpoint) -> None:
    folder = Path(end.host).parent
    try:
        mode = folder.stat().st_mode
    except OSError as error:
        raise LinkError(f"listening at {end.text}: folder {folder}: {error.strerror}") from None
    if mode & 0o077:
        raise LinkError(
            f"listening at {end.text}: other users can enter {folder} (mode {mode & 0o777:04o}); `chmod 700 {folder}`"
        )


def _find_wait(connect: list[Endpoint]) -> int:
    return FIND_WAIT_FAR if any(_leaves(end) for end in connect) else FIND_WAIT


def _leaves(end: Endpoint) -> bool:
    return end.is_secure or not end.is_local


def _two_links(end: Endpoint) -> str | dict[str, Any]:
    if end.priorities:
        return end.text
    return {"strategy": "allOf", "locators": [f"{end.text}?{URGENT}", f"{end.text}?{REST}"]}


def _transport(link: Link, ends: list[Endpoint], now: datetime) -> dict[str, Any]:
    two = any(_leaves(end) for end in ends)
    buffer = {"so_sndbuf": SEND_BUFFER} if two else {}
    queue = {
        "congestion_control": {
            "drop": {"wait_before_drop": DROP_WAIT, "max_wait_before_drop_fragments": DROP_WAIT_FRAGMENTS},
            "block": {"wait_before_close": CLOSE_WAIT},
        }
    }
    return {
        "unicast": {
            "open_timeout": OPEN_WAIT,
            "accept_timeout": OPEN_WAIT,
            "max_links": 2 if two else 1,
        },
        "link": {
            "protocols": sorted({end.protocol for end in ends}),
            "tx": {"lease": LEASE, "keep_alive": 4, "queue": queue},
            "rx": {"max_message_size": LARGEST + 2**20},
            "tcp": buffer,
            "tls": {**_credentials(link, now), **buffer} if any(end.is_secure for end in ends) else {},
        },
        "shared_memory": {
            "enabled": link.shared_memory,
            "transport_optimization": {"enabled": link.shared_memory, "pool_size": POOL},
        },
    }


def credential_files(link: Link) -> tuple[Path, Path, Path]:
    """Certificates of the authority and of a link's own identity, and its private key."""
    assert link.credentials is not None and link.identity is not None
    names = ("ca.pem", f"{link.identity}.pem", f"{link.identity}-key.pem")
    authority, certificate, key = (link.credentials / name for name in names)
    return authority, certificate, key


def _credentials(link: Link, now: datetime) -> dict[str, Any]:
    """Zenoh's TLS settings, with every file looked at: its own errors name none."""
    if link.credentials is None or link.identity is None:
        raise LinkError(
            "TLS without certificates: make them with `navloom keys new DIR`, then give --keys DIR or set live.keys"
        )
    folder = link.credentials
    authority, certificate, key = credential_files(link)
    for path in (authority, certificate, key):
        _refuse_unreadable(path, folder)
    mode = key.stat().st_mode
    if mode & 0o077:
        raise LinkError(f"private key {key}: other users can read it (mode {mode & 0o777:04o}); `chmod 600 {key}`")
    from navloom.transport.validity import why_unusable  # takes 60 ms to load, which only TLS has to pay

    why = why_unusable(certificate, key, authority, now)
    if why:
        raise LinkError(why)
    return {
        "root_ca_certificate": str(authority),
        "listen_certificate": str(certificate),
        "listen_private_key": str(key),
        "connect_certificate": str(certificate),
        "connect_private_key": str(key),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _refuse_unreadable(path: Path, folder: Path) -> None:
    try:
        with open_file(path, LinkError) as file:
            is_pem = file.read(11) == b"-----BEGIN "
    except OSError as error:
        there = sorted(other.stem for other in folder.glob("*.pem") if (folder / f"{other.stem}-key.pem").exists())
        known = f"; {folder} has certificates of {', '.join(there)}" if there else ""
        raise LinkError(f"certificate file {path}: {error.strerror}{known}; `navloom keys` makes them") from None
    if not is_pem:
        raise LinkError(f"certificate file {path}: not in PEM form; `navloom keys` makes such files")


def _access(link: Link, listen: list[Endpoint]) -> dict[str, Any]:
    for end in listen:
        if not end.is_secure:
            raise LinkError(
                f"listening at {end.text} beside TLS: access goes by certificate, so nobody could do anything there; "
                "listen at TLS endpoints alone"
            )
    assert link.credentials is not None
    try:
        identities = read_identities(link.credentials, link.realm, link.robot)
        allowed = rules(link.realm, link.robot, identities, link.streams)
    except AccessError as error:
        raise LinkError(str(error)) from None
    return {"access_control": allowed, **limits(link.realm, link.robot, identities, link.streams)}
