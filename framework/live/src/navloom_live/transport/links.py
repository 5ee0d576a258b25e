"""How a process joins a robot's network: Zenoh's settings for a link, and refusal of unsafe links."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from navloom.inputs.bounds import open_file

from navloom_live.timing import GATHER_WAIT, LINK_CLOSE_WAIT, LINK_LEASE, LINK_RETRY_FIRST, LINK_RETRY_MOST
from navloom_live.transport.access import AccessError, limits, read_identities, rules
from navloom_live.transport.endpoints import Endpoint, LinkError
from navloom_live.transport.keyspace import LARGEST

__all__ = ["Endpoint", "Link", "LinkError", "Mesh", "credential_files", "peer_link", "settings"]

FIND_WAIT, FIND_WAIT_FAR = 2000, 5000
"""How long a client tries to find its router, on this host and on another, ms: at 0.2 s round trip, TLS takes 1.3 s."""
HANDSHAKE_LIMIT = 5000
"""Longest handshake of a neighbour, ms, so that idle strangers cannot occupy connections for long."""
RETRY_GONE = 60_000
"""Longest interval of connection attempts to a router's predecessor, ms: once it has gone, it does not return."""
DROP_WAIT = 1000
"""How long a droppable message waits for a place in the queue, µs: a twentieth of the shortest usual period."""
DROP_WAIT_FRAGMENTS = 50_000
"""The same for all fragments of a large droppable message, µs: one period of 0.05 s; after that a newer one follows."""
SEND_BUFFER = 65_536
"""Send buffer in the kernel of a link that leaves the host, bytes: priorities have no effect in it."""
POOL = 16 * 2**20
"""Shared memory for large messages, bytes. It is allocated when the first one is sent, which takes 15 to 85 ms. Readers
keep the pools of processes that have died, so it is no larger than a few of the largest usual messages."""
URGENT, REST = "prio=0-3", "prio=4-7"
"""Priorities of the two links to another host: commands and poses do not wait behind a map. A client whose router
restarted gets only one of them back, which then carries everything: https://github.com/eclipse-zenoh/zenoh/issues/2130
"""

_MODES = ("peer", "client", "router")


@dataclass(frozen=True)
class Link:
    """How a process joins a robot's network.

    Attributes:
        mode: peer, client or router.
        listen, connect: Endpoints, as unixsock-stream//run/x/drive.sock, tcp/127.0.0.1:7447 or tls/10.0.0.1:7447.
        credentials: Folder with ca.pem, NAME.pem and NAME-key.pem, and identities.json for a listener; or None.
        identity: The NAME.
        insecure: Plain TCP to other hosts is allowed.
        realm, robot: Names of the robot, whose keys the rules of a TLS listener protect.
        peers: Number of neighbours that opening waits for, at most for GATHER_WAIT.
        shared_memory: Large messages use shared memory, see POOL.
        door: For a router over TLS: socket of this host by which its successor connects when certificates change.
        predecessor: For a router that takes over from another: the door of that one.
        streams: Streams of the robot, as role/instance/port, to which readers may subscribe; empty if unknown.
        mesh: For a client: how it connects directly to the processes of its own host; None for only by the router.
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
        """Whether part of the robot may be behind a router."""
        return self.mode == "client" and not (self.mesh is not None and self.mesh.is_whole)


@dataclass(frozen=True)
class Mesh:
    """Processes of one host that connect by sockets, in addition to a router.

    Attributes:
        link: Link of one of them to the others.
        here: Their nodes, as role/instance, and the processes themselves, as process/name.
        is_whole: They are all processes of the robot.
    """

    link: Link
    here: tuple[str, ...]
    is_whole: bool


def certificate(keys: Path | None, usual: str) -> tuple[Path | None, str | None]:
    """Folder and name of the certificate to use: from a file NAME.pem, or the name `usual` in a folder."""
    if keys is None:
        return None, None
    return (keys.parent, keys.stem) if keys.suffix == ".pem" else (keys, usual)


def peer_link(own: str, sockets: Iterable[str], realm: str, robot: str, shared_memory: bool = False) -> Link:
    """Link of a process to its neighbours on one host. Of two, the one whose socket name sorts later connects.

    If both connected, a process that was stopped and continues could keep its half of a link that the other has closed,
    and messages would be misrouted: https://github.com/eclipse-zenoh/zenoh/issues/2806

    Args:
        own: Socket on which it listens.
        sockets: Sockets of all processes.
        realm, robot: Names of the robot.
        shared_memory: Large messages use shared memory.
    """
    others = sorted({*sockets} - {own})
    earlier = tuple(end for end in others if end < own)
    return Link("peer", (own,), earlier, realm=realm, robot=robot, peers=len(others), shared_memory=shared_memory)


def settings(link: Link, now: datetime | None = None) -> dict[str, Any]:
    """Zenoh's configuration for a link, as JSON values.

    Args:
        link: How to join.
        now: Time for checking certificates, with its time zone; None for this host's clock.

    Raises:
        LinkError: The link is refused: unsafe, incomplete or malformed.
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
    # After the checks, which are for endpoints that others may reach.
    connect += [Endpoint.parse(link.predecessor)] if link.predecessor else []
    ends = [*listen, *connect]
    is_client = link.mode == "client"
    found: dict[str, Any] = {
        "mode": link.mode,
        "scouting": {
            # A router waits for nobody; a peer is linked to all running ones when it opens.
            "delay": 0 if link.mode == "router" else _ms(GATHER_WAIT),
            # Robots of one network must not find each other by themselves.
            "multicast": {"enabled": False},
            # A peer would connect to every address that another one tells it.
            "gossip": {"enabled": False},
        },
        "listen": {"endpoints": [end.text for end in listen], "exit_on_failure": True},
        "connect": {
            "endpoints": [_two_links(end) if _leaves(end) else end.text for end in connect],
            "timeout_ms": _find_wait(connect) if is_client else -1,
            "exit_on_failure": is_client,
            "retry": {
                "period_init_ms": _ms(LINK_RETRY_FIRST),
                "period_max_ms": RETRY_GONE if link.predecessor else _ms(LINK_RETRY_MOST),
                "period_increase_factor": 2,
            },
        },
        # Stamps of hosts' clocks are of no use: robots' hosts need no common time.
        "timestamping": {"enabled": False},
        # It would let any client read, and with write access change, the settings of a session.
        "adminspace": {"enabled": False},
        "transport": _transport(link, ends, now or datetime.now(UTC)),
    }
    found |= access
    return found


def _refuse_listening(link: Link, end: Endpoint) -> None:
    # Also with --insecure: that option is for a closed network, and this would be all networks.
    if end.is_wildcard and not end.is_secure:
        raise LinkError(
            f"listening at {end.text}: anyone who reaches this host could drive the robot, so every interface needs "
            f"TLS: make certificates with `navloom keys new DIR` and use tls/…:{end.port}, "
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


def _ms(seconds: float) -> int:
    """In ms, as Zenoh expects its times."""
    return round(seconds * 1e3)


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
            "block": {"wait_before_close": round(LINK_CLOSE_WAIT * 1e6)},
        }
    }
    return {
        "unicast": {
            "open_timeout": HANDSHAKE_LIMIT,
            "accept_timeout": HANDSHAKE_LIMIT,
            "max_links": 2 if two else 1,
        },
        "link": {
            "protocols": sorted({end.protocol for end in ends}),
            "tx": {"lease": _ms(LINK_LEASE), "keep_alive": 4, "queue": queue},
            # A little above the limit, so that a message of exactly LARGEST fits with its header.
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
    """Files of the authority's certificate, the link's own certificate, and its private key."""
    assert link.credentials is not None and link.identity is not None
    names = ("ca.pem", f"{link.identity}.pem", f"{link.identity}-key.pem")
    authority, certificate, key = (link.credentials / name for name in names)
    return authority, certificate, key


def _credentials(link: Link, now: datetime) -> dict[str, Any]:
    """Zenoh's TLS settings. Every file is checked first, since Zenoh's own errors name no file."""
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
    from navloom_live.transport.certificate_validity import why_unusable  # takes 60 ms to load: only for TLS

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
        # A certificate of another robot's router, made by the same authority, must not do.
        "verify_name_on_connect": True,
        # An expired certificate must also end links that are open already.
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
                f"listening at {end.text} beside TLS: access needs certificates, so clients could do nothing there; "
                "listen only at TLS endpoints"
            )
    assert link.credentials is not None
    try:
        identities = read_identities(link.credentials, link.realm, link.robot)
        allowed = rules(link.realm, link.robot, identities, link.streams)
    except AccessError as error:
        raise LinkError(str(error)) from None
    return {"access_control": allowed, **limits(link.realm, link.robot, identities, link.streams)}
