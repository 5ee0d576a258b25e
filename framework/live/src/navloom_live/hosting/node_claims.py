"""Claims of a robot's nodes: of two processes that would run the same node, only one may start.

Two robots of one name, from a copied config or disk, take each other's goals and commands. A runtime folder shows only
what was started with the same environment on the same host, so each node is claimed in two further places:

- On this host by an abstract socket of its name. The kernel releases it with its process, it needs no folder, and it is
  the same whether or not a shell has XDG_RUNTIME_DIR. Only Linux has them. One of another user is not believed.
- On the robot's network, if there is a router, by a liveliness token with host, process and time of the start.
"""

from __future__ import annotations

import contextlib
import os
import platform
import secrets
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from navloom_live.hosting.runtime_folders import DirectoryError, runtime_folder
from navloom_live.timing import DEAD_TOKEN_WAIT, TOKEN_SETTLE_WAIT
from navloom_live.transport.connection import Connection
from navloom_live.transport.keyspace import CLAIM, KeySpace, key_part
from navloom_live.transport.link_faults import why_not
from navloom_live.transport.links import Link

if TYPE_CHECKING:  # tools that look for a robot load no nodes
    from navloom_live.live.live_node import Source

__all__ = ["Claimant", "Claims", "claimant_of", "elsewhere", "process_start"]

STARTING, RUNNING = "starting", "running"
"""States in a token. A running process keeps its nodes; of two that start at the same moment, the lower key wins."""
USUAL = "usual"
"""Part of the names of sockets of robots without a NAVLOOM_RUNTIME_DIR."""
ROUTER_FIND_WAIT = 1.0
"""Longest wait for a router before the start, s; longer than joining one takes that is there."""
CLAIM_CHECK_INTERVAL = 0.05
"""Interval of looking, s."""


class Claimant(NamedTuple):
    """A process that has claimed a node.

    Attributes:
        started: Wall clock of its host at its start, s since 1970.
        host, pid: Where it runs.
        mark: Distinguishes two that are otherwise equal.
    """

    started: float
    host: str
    pid: int
    mark: str = ""

    def __str__(self) -> str:
        return f"on host {self.host}, process {self.pid}, since {self.since}"

    @property
    def since(self) -> str:
        """Time of its start on this host's clock."""
        return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.started))

    @property
    def text(self) -> str:
        """Its part of a token's key; the order of these texts decides between two that start together."""
        return f"{self.started:017.3f}~{key_part(self.host)}~{self.pid}~{self.mark}"


def claimant_of(text: str) -> Claimant | None:
    """The claimant that a token names; None for another text."""
    started, _, rest = text.partition("~")
    host, _, rest = rest.partition("~")
    pid, _, mark = rest.partition("~")
    try:
        return Claimant(float(started), host, int(pid), mark)
    except ValueError:
        return None


class Claims:
    """The claims of one process. Use it in a `with` statement; it releases them at its end.

    Args:
        keys: Keys of the robot.
        sources: Its nodes.
        say: Receives a message if another process claims one of them later.

    Attributes:
        lost: Why this process must not go on, if it found another one only after its start; empty otherwise.
    """

    def __init__(self, keys: KeySpace, sources: Iterable[Source], say: Callable[[str], None]) -> None:
        self.lost = ""
        self._keys, self._sources, self._say = keys, [*sources], say
        # The wall clock, for people to read; it decides only between two that start together, and then any order will
        # do.
        self._own = Claimant(time.time(), platform.node(), os.getpid(), secrets.token_hex(4))
        self._sockets: list[socket.socket] = []
        self._connection: Connection | None = None
        self._closing = threading.Event()
        self._later: threading.Thread | None = None
        self._told: set[Claimant] = set()
        os.register_at_fork(after_in_child=self._drop)

    def __enter__(self) -> Claims:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Release all claims."""
        self.leave_network()
        self._drop()

    def leave_network(self) -> None:
        """Release the claims on the network: before a router of this process ends, which it would otherwise rejoin."""
        self._closing.set()
        if self._later is not None:  # Python's exit would cut a thread inside Zenoh off, which aborts the process
            self._later.join()
            self._later = None
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _drop(self) -> None:
        """Release the sockets; a forked child must not hold them for its parent's successor."""
        while self._sockets:
            self._sockets.pop().close()

    def take_here(self) -> None:
        """Claim the nodes on this host. Raises DirectoryError, with who has claimed one."""
        for source in self._sources if sys.platform == "linux" else ():
            # Datagrams need no `listen`: the bound name is the claim.
            one = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            try:
                one.bind(_address(self._keys, source))
            except OSError:
                one.close()
                pid = _holder(_address(self._keys, source))
                if pid is None:  # of another user, who may block a name, but not a robot
                    self._say(f"another user holds the name of {' '.join(source)} of robot {self._keys.prefix}")
                    continue
                holder = Claimant(process_start(pid) or time.time(), platform.node(), pid)
                raise DirectoryError(self._refusal(source, holder)) from None
            self._sockets.append(one)

    def take_on(self, link: Link, now: bool) -> None:
        """Claim the nodes on the robot's network, behind its router.

        A router that is not there yet is joined later. What is found then is in `lost`, until the robot is complete.

        Args:
            link: Link of a client of the router.
            now: Wait a moment for the router; otherwise it is only about to start.

        Raises:
            DirectoryError: Another process runs one of the nodes, or starts it at the same moment and takes precedence.
        """
        if not self._sources:  # of a host with nothing but the router
            return
        limit = time.monotonic() + ROUTER_FIND_WAIT
        while (away := why_not(link, ROUTER_FIND_WAIT)) and now and time.monotonic() < limit:
            time.sleep(CLAIM_CHECK_INTERVAL)
        if not away and (connection := self._joined(link)) is not None:
            if refusal := self._decide(connection):
                raise DirectoryError(refusal)
        else:
            self._later = threading.Thread(target=self._take_later, args=(link,), name="claims", daemon=True)
            self._later.start()

    def _joined(self, link: Link) -> Connection | None:
        """The connection to a router that is there; None if it does not let this process join soon.

        Without a router, no session is opened: one that waits for it when the process ends aborts the process.
        """
        connection = self._connection = self._connection or Connection(link, waits=False)
        limit = time.monotonic() + ROUTER_FIND_WAIT
        while not connection.neighbours() and time.monotonic() < limit and not self._closing.wait(CLAIM_CHECK_INTERVAL):
            pass
        return connection if connection.neighbours() else None

    def _take_later(self, link: Link) -> None:
        while why_not(link, ROUTER_FIND_WAIT) or (connection := self._joined(link)) is None:
            if self._closing.wait(CLAIM_CHECK_INTERVAL):
                return
        lost = self._decide(connection)
        if self._closing.is_set():
            return
        self.lost = lost
        if self.lost:  # a robot that is complete by now goes on: `navloom doctor` names both
            self._say(self.lost)
            self._announce(connection, RUNNING)

    def _decide(self, connection: Connection) -> str:
        """Declare the tokens, and look for those of others until it is clear who has the nodes; why not, or empty."""
        # The token first, then the look: of two that start together, at least one sees the other.
        self._announce(connection, STARTING)
        limit = time.monotonic() + DEAD_TOKEN_WAIT
        self._closing.wait(TOKEN_SETTLE_WAIT)
        while found := next(self._prior(connection), None):
            if time.monotonic() > limit or self._closing.wait(CLAIM_CHECK_INTERVAL):
                return self._refusal(*found)
        self._announce(connection, RUNNING)
        # Two halves of a network that was cut may both have found nobody.
        connection.watch(self._keys.port("*", "*", f"{CLAIM}/{RUNNING}/*"), self._note)
        return ""

    def _announce(self, connection: Connection, state: str) -> None:
        for role, name in self._sources:
            connection.announce(self._keys.port(role, name, f"{CLAIM}/{state}/{self._own.text}"))

    def _prior(self, connection: Connection) -> Iterator[tuple[Source, Claimant]]:
        """Claims of others that take precedence over this process's own."""
        for answer in connection.alive(self._keys.port("*", "*", f"{CLAIM}/*/*"), 1.0):
            source, state, text = self._read(answer.key)
            claimant = claimant_of(text)
            # A node that runs may be driving: it stays, however late its start was.
            is_prior = state == RUNNING or text < self._own.text
            if source in self._sources and claimant is not None and text != self._own.text and is_prior:
                yield source, claimant

    def _note(self, key: str, is_there: bool) -> None:
        """Another process runs one of the nodes too: the network was cut in two when one of them started."""
        source, _, text = self._read(key)
        claimant = claimant_of(text)
        is_other = is_there and source in self._sources and text != self._own.text
        if is_other and claimant is not None and claimant not in self._told:
            self._told.add(claimant)
            self._say(f"{self._refusal(source, claimant)}; `navloom doctor` names both")

    def _read(self, key: str) -> tuple[Source, str, str]:
        """Node, state and claimant of a token's key."""
        parts = [*key.removeprefix(f"{self._keys.prefix}/").split("/"), "", "", "", "", ""]
        return (parts[0], parts[1]), parts[3], parts[4]

    def _refusal(self, source: Source, claimant: Claimant) -> str:
        return (
            f"robot {self._keys.prefix}: {' '.join(source)} runs already {claimant}; end that one first, "
            f"or start this one under another name with --set robot.name=NAME"
        )


def _address(keys: KeySpace, source: Source) -> str:
    """Abstract socket of a node: one for each user, and one for each NAVLOOM_RUNTIME_DIR, which keeps robots apart."""
    given = os.environ.get("NAVLOOM_RUNTIME_DIR")
    scope = f"in:{Path(given).resolve()}" if given else USUAL
    text = f"navloom/{os.getuid()}/{scope}/{keys.prefix}/{'/'.join(source)}"
    if len(text.encode()) > 100:  # a socket's name has at most 107 bytes
        # Names this long are rare, and commands that only look should start fast.
        from hashlib import sha256

        text = f"navloom/{os.getuid()}/{sha256(text.encode()).hexdigest()[:40]}"
    return f"\0{text}"


def elsewhere() -> dict[str, Path]:
    """Robots of this user that run on this host, but in a runtime folder that this process does not use, by REALM/NAME.

    Their shells have another XDG_RUNTIME_DIR or TMPDIR. With a NAVLOOM_RUNTIME_DIR, robots are kept apart on purpose.
    """
    paths: dict[str, Path] = {}
    if os.environ.get("NAVLOOM_RUNTIME_DIR"):
        return paths
    begin = f"@navloom/{os.getuid()}/{USUAL}/"
    for name in sorted(name for name in _abstract() if name.startswith(begin)):
        realm, robot, *_ = name.removeprefix(begin).split("/")
        pid = None if f"{realm}/{robot}" in paths else _holder(f"\0{name[1:]}")
        folder = None if pid is None else _folder_of(pid)
        if folder is not None and folder != runtime_folder():
            paths[f"{realm}/{robot}"] = folder
    return paths


def _folder_of(pid: int) -> Path | None:
    """Runtime folder that a process of this user uses, by its environment."""
    try:
        text = Path(f"/proc/{pid}/environ").read_bytes().decode("utf-8", "surrogateescape")
    except OSError:
        return None
    return runtime_folder(dict(entry.split("=", 1) for entry in text.split("\0") if "=" in entry))


def _abstract() -> dict[str, str]:
    """Abstract sockets of this host: name, as @…, and how a link in /proc names each."""
    try:
        # Names of sockets may hold blanks.
        lines = [line.split(maxsplit=7) for line in Path("/proc/net/unix").read_text("utf-8").splitlines()]
    except OSError:
        return {}
    return {line[7]: f"socket:[{line[6]}]" for line in lines if len(line) == 8 and line[7].startswith("@")}


def _holder(address: str) -> int | None:
    """Process of this user that holds an abstract socket; None if it is another user's."""
    link = _abstract().get(f"@{address[1:]}")
    if link is None:
        return None
    pids = sorted(int(entry) for entry in os.listdir("/proc") if entry.isdecimal())
    return next((pid for pid in pids if link in _open_files(pid)), None)


def _open_files(pid: int) -> set[str]:
    """What a process of this user has open, as its links name it; empty for a process of others."""
    found: set[str] = set()
    with contextlib.suppress(OSError):
        if os.stat(f"/proc/{pid}").st_uid == os.getuid():
            for number in os.listdir(f"/proc/{pid}/fd"):
                with contextlib.suppress(OSError):
                    found.add(os.readlink(f"/proc/{pid}/fd/{number}"))
    return found


def process_start(pid: int) -> float | None:
    """When a process of this host started, s since 1970; None if that is not known."""
    try:
        # From the last parenthesis on: the name of a program may hold blanks and parentheses.
        ticks = int(Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return None
    # `/proc` counts from boot, and CLOCK_BOOTTIME includes the time in suspend as those ticks do.
    return time.time() - (time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK"))
