"""A live robot from the side that starts it: its folder, its processes, and whether all nodes are alive."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from types import TracebackType

from navloom.engine.system import System
from navloom.errors import NavloomError
from navloom.kernel_progress import Kernels

from navloom_live.hosting.addition_service import Additions
from navloom_live.hosting.network import Network
from navloom_live.hosting.node_claims import Claimant, Claims, process_start
from navloom_live.hosting.node_process import Share
from navloom_live.hosting.process_tasks import ProcessTask, node_task, router_task
from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder, Running
from navloom_live.hosting.supervisor import Supervisor
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.node_placement import spread
from navloom_live.live.presence import Presence
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.replicated_state import Memory
from navloom_live.live.replicated_state_reader import MemoryReader
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.tool_sessions import expiring
from navloom_live.transport.zenoh_bus import Bus

__all__ = ["Beside", "LiveRobot", "StartError"]

EXPIRY_WARNING_INTERVAL = 86400.0
"""Interval of warnings about certificates that expire soon, s."""
OWN_ROUTER_WAIT = 15.0
"""Longest wait for a router that this host starts, s."""
ROUTER_SHOWS_WAIT = 5.0
"""Longest wait until the router shows the running processes, s."""


class StartError(NavloomError, RuntimeError):
    """The robot did not come up. The text names the missing nodes and the last lines of their logs."""

    exit_code = 1


class LiveRobot:
    """The supervised processes of a robot on this host. Use it in a `with` statement.

    Args:
        system: The robot.
        network: How its processes find each other.
        host: Host of the config's `[live.hosts]` whose processes to start; None for all.
        barrier: Run under the barrier; no process is restarted then.
        say: Receives messages about what happens.
        attended: A recorder joins the robot and must not miss the first tick.
        ends: Checked while waiting for the router; True cancels the start.

    Raises:
        DirectoryError: It is up already, or its folder cannot be used; LinkError, BusError: it cannot join its network.
    """

    def __init__(
        self,
        system: System,
        network: Network,
        host: str | None,
        barrier: bool,
        say: Callable[[str], None],
        attended: bool = False,
        ends: Callable[[], bool] = lambda: False,
    ) -> None:
        config = system.config
        self.system, self.network, self.barrier, self.attended = system, network, barrier, attended
        self.keys = KeySpace(config.robot.realm, config.robot.name)
        self.folder = RobotFolder(config.robot.realm, config.robot.name)
        self.started_ns = time.monotonic_ns()
        self._shares: Mapping[str, Sequence[Source]] = spread(config, all_sources(system), host)
        self._say, self._ends = say, ends
        self._changed = threading.Condition()
        self._presence = Presence(self.keys, (), self._came)
        self._memory, self._ended = Memory(), threading.Event()
        self._claims = Claims(self.keys, [source for share in self._shares.values() for source in share], say)
        self._warned = -math.inf

    def __enter__(self) -> LiveRobot:
        self.network.check()
        self.warn_of_expiry()
        self.folder.make()
        # The lock decides, not the description, which a killed supervisor leaves behind.
        if not self.folder.lock():
            running = self.folder.read()
            who = "" if running is None else f" ({_claimant(running.pid)})"
            ends = f"`navloom down --robot {self.keys.prefix}` ends it"
            if running is not None and not running.supervised:
                ends = "its nodes were started one by one: end those first"
            raise DirectoryError(
                f"robot {self.keys.prefix} is up already{who}: {ends}, or --set robot.name=NAME starts another"
            )
        try:
            self._claim()
            self.folder.clear()
            self.supervisor = Supervisor(
                self.system.loaded.config.live, self.folder, self._tasks(), self._say, self._memory.to_bytes
            )
        except BaseException:
            self._claims.release()
            self.folder.unlock()
            raise
        try:
            self.supervisor.start()
            self.folder.write(self.running())
            link, starts_router = self.network.outsider(self.folder, self._shares), self.network.starts_router
            patience = OWN_ROUTER_WAIT if starts_router else math.inf  # another host's router may start at any time
            self.bus = Bus(link, patience, self._say, lambda: not self._ends(), waits=starts_router)
            if not self.barrier:
                self._remember()
            self._offer_additions()
            self.bus.watch(self.keys.alive("*", "*", "*"), self._presence.change)
        except BaseException:
            self._stop()
            raise
        return self

    def _claim(self) -> None:
        """Claim the nodes of this host's share before anything is started. Raises DirectoryError."""
        self._claims.take_here()
        if self.network.router and not self.barrier:
            self._claims.take_on(self.network.alone(), now=not self.network.starts_router)

    def warn_of_expiry(self) -> None:
        """Warn once a day of certificates that expire soon: when they do, the robot's links fail, and it stops."""
        if time.monotonic() - self._warned > EXPIRY_WARNING_INTERVAL:
            self._warned = time.monotonic()
            for warning in expiring(self.network.folder):
                self._say(warning)

    def _remember(self) -> None:
        """Keep a copy of the robot's memory here too, in case a single process is the only one that has it."""
        board = Switchboard(self.bus, self.keys, lossless=False)
        monitor = MemoryReader(self.system, board, None, self._memory, lambda entry: None, self._ended.is_set)
        self._board, self._monitor = board, monitor
        board.connect()
        threading.Thread(target=monitor.run, daemon=True).start()
        threading.Thread(target=self._presence.follow, args=(board.fetch, self._ended.is_set), daemon=True).start()

    def _offer_additions(self) -> None:
        """Let clients add instances to this robot."""
        Additions(
            self.system, self._shares, self.folder, self.network, self.supervisor, self.bus, self.keys, self.barrier,
            self.started_ns, self._gain, self._say,
        ).offer()  # fmt: skip

    def _gain(self, system: System, shares: Mapping[str, Sequence[Source]], source: Source) -> None:
        """Take in an instance that was added. On a service's thread."""
        self.system, self._shares = system, dict(shares)
        self._monitor.follow(source)
        self._board.connect()
        self.folder.write(self.running())

    def _tasks(self) -> list[ProcessTask]:
        """The processes of this host, its router first if it starts one."""
        links = self.network.links(self.folder, self._shares)
        shares = [
            Share(name, tuple(sources), links[name], self.barrier, self.started_ns, self.attended)
            for name, sources in self._shares.items()
        ]
        router = self.network.router_link()
        return [
            *([] if router is None else [router_task(router)]),
            *(node_task(self.system.loaded, share) for share in shares),
        ]

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._stop()
        finally:
            self.bus.close()

    def running(self) -> Running:
        """The contents of the runtime file."""
        ends = self.network.outsider(self.folder, self._shares)
        return Running(
            self.keys.realm, self.keys.robot, os.getpid(), (*ends.connect, *ends.listen), ends.mode == "client",
            self.system.loaded.name, self.barrier, str(ends.credentials.absolute()) if ends.credentials else "",
        )  # fmt: skip

    def missing(self) -> list[Source]:
        """Nodes of the whole robot that are not alive."""
        sources = [source for source in all_sources(self.system) if source[0] != "operator"]
        return [source for source in sources if not self._presence.is_alive(source)]

    def wait_complete(
        self,
        timeout: float,
        progress: Callable[[Sequence[Source], int, Kernels], None] = lambda left, total, kernels: None,
        ends: Callable[[], bool] = lambda: False,
    ) -> None:
        """Wait until every node is alive, or `ends` cancels the wait.

        Args:
            timeout: Longest time without progress, s.
            progress: Called with the missing nodes, the number of all, and the kernels of all processes that compile.
            ends: Whether to give up.

        Raises:
            StartError: A node is missing and nothing has come up or been compiled for `timeout`, or a process cannot
                start.
        """
        limit, before = time.monotonic() + timeout, (0, Kernels())
        total = sum(source[0] != "operator" for source in all_sources(self.system))
        while (missing := self.missing()) and not ends():
            told = [child.heart.kernels for child in self.supervisor.children.values()]
            kernels = Kernels(*(sum(column) for column in zip(*told, strict=True)))
            progress(missing, total, kernels)
            if before != (len(missing), kernels):
                limit, before = time.monotonic() + timeout, (len(missing), kernels)
            if self._claims.lost:
                raise DirectoryError(self._claims.lost)
            for child in self.supervisor.poll(restarts=not self.barrier):
                # Code 2 fails in the same way each time; other crashes are restarted.
                if self.barrier or child.state == "failed" or child.why == "ended with code 2":
                    raise StartError(
                        f"process {child.task.name} {child.why}: {self.supervisor.tail(child) or 'no output'}"
                    )
            if time.monotonic() > limit:
                names = ", ".join(f"{role} {name}" for role, name in missing)
                raise StartError(f"not up, and without progress for {timeout:g} s: {names}; {self._advice(missing)}")
            with self._changed:
                # Also without news: a process may have died.
                self._changed.wait(0.2)
        self._await_reachable(ends)

    def _await_reachable(self, ends: Callable[[], bool]) -> None:
        """Wait a moment until the router, if there is one, shows the processes of this host to tools."""
        if not self.network.router:
            return
        wanted = {f"{role}/{name}" for sources in self._shares.values() for role, name in sources}
        limit = time.monotonic() + ROUTER_SHOWS_WAIT
        while self.bus.has_router() and time.monotonic() < limit and not ends():
            shown = {"/".join(self.keys.split(key)[:2]) for key in self.bus.shown(self.keys.alive("*", "*", "*"))}
            if wanted <= shown:
                return
            time.sleep(0.05)

    def _advice(self, missing: Sequence[Source]) -> str:
        here = {source for sources in self._shares.values() for source in sources}
        away = [source for source in missing if source not in here]
        if away:
            return "they belong to other hosts: start those with `navloom up --host NAME`, and see `navloom doctor`"
        said = [f"{name}: {self.supervisor.tail(child)}" for name, child in self.supervisor.children.items()]
        return "last messages of their processes: " + " | ".join(said)

    def _came(self, source: Source, again: bool) -> None:
        with self._changed:
            self._changed.notify_all()

    def _stop(self) -> None:
        self._ended.set()
        try:
            # The claims would rejoin the router, which is about to end.
            if self.network.starts_router:
                self._claims.leave_network()
            self.supervisor.stop()
            # If it was deleted and made by another robot, its files are that robot's.
            if self.folder.is_there():
                self.folder.clear()
        finally:
            self._claims.release()
            self.folder.unlock()


def _claimant(pid: int) -> str:
    """Process of this host and since when, in words."""
    started = process_start(pid)
    return f"process {pid}" if started is None else f"process {pid}, since {Claimant(started, '', pid).since}"


Beside = Callable[[LiveRobot], AbstractContextManager[None]]
"""What runs beside a robot, as a recorder, from the moment it is up."""
