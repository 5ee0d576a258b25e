"""The supervisor: starts a robot's processes, restarts those that crash, and ends them all."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from navloom.config.tables import LiveTable

from navloom_live.hosting.descendants import PROCESS, Descendant, descendants, end_all, left_of, mark, reap_orphans
from navloom_live.hosting.folder_keeper import FolderKeeper
from navloom_live.hosting.fork_server import ForkedProcess, Nursery
from navloom_live.hosting.heartbeat import HeartMonitor
from navloom_live.hosting.node_process import HUNG
from navloom_live.hosting.process_log import LARGEST_LOG, ProcessLog, last_crash, older_log
from navloom_live.hosting.process_setup import SEIZED
from navloom_live.hosting.process_tasks import NODE, ProcessTask
from navloom_live.hosting.runtime_folders import Fate, RobotFolder
from navloom_live.hosting.shared_memory import remove_orphans
from navloom_live.timing import (
    DUMP_WAIT,
    FORK_SERVER_READY,
    GROUP_STOP_WAIT,
    HEALTHY_AFTER,
    RESTART_WAIT_FIRST,
    RESTART_WAIT_MOST,
)
from navloom_live.transport.keyspace import SUPERVISOR

__all__ = ["Supervisor", "Worker"]

UNFIT = 2
"""Exit code of a process that cannot run what it is asked to."""
CHORE_INTERVAL = 0.5
"""Interval of checks that are not urgent: the folder and orphans, s."""
STATUS_RETRY_WAIT = 1.0
"""Wait before another attempt to write the status of the processes, s."""


@dataclass(eq=False)
class Worker:
    """A supervised process and its state.

    Attributes:
        task: Its description.
        process: The running process; None while there is none.
        crashes: Times of its crashes within the window, s, monotonic clock.
        restarts: Number of restarts.
        state: starting, running, waiting (for its restart), failed or ended.
        why: How it ended last.
        verdict: Why the supervisor has killed it; empty if it has not.
        log: Its log.
        heart: Its heartbeat, if it must give one.
        spec: File descriptor of its start parameters, in memory; -1 for none.
        is_added: It was added to a robot that was up: the others go on without it if it does not start.
    """

    task: ProcessTask
    log: ProcessLog
    heart: HeartMonitor
    process: subprocess.Popen[bytes] | ForkedProcess | None = None
    started: float = 0.0
    again_at: float = 0.0
    wait: float = RESTART_WAIT_FIRST
    crashes: deque[float] = field(default_factory=deque)
    restarts: int = 0
    state: str = "starting"
    why: str = ""
    verdict: str = ""
    spec: int = -1
    is_added: bool = False


class Supervisor:
    """Keeps the processes of one host running.

    Args:
        live: Limits of restarts.
        folder: The robot's folder.
        tasks: The processes.
        say: Receives messages about what happens to them.
        recall: The robot's memory, as JSON, for a process that is started.
    """

    def __init__(
        self,
        live: LiveTable,
        folder: RobotFolder,
        tasks: Sequence[ProcessTask],
        say: Callable[[str], None],
        recall: Callable[[], bytes] = bytes,
    ) -> None:
        self._live, self._folder, self._say, self._recall = live, folder, say, recall
        self.children = {
            task.name: Worker(task, ProcessLog(folder.path / f"{task.name}.log"), HeartMonitor()) for task in tasks
        }
        self._groups: set[int] = set()
        self._keeper = FolderKeeper(folder, [*self.children, SUPERVISOR], say)
        self._cannot_write = ""
        self._write_again = math.inf
        self._chores_at = 0.0
        self._added: deque[ProcessTask] = deque()
        self._nursery: Nursery | None = None
        if Nursery.is_possible() and any(task.module == NODE for task in tasks):
            self._nursery = Nursery(folder.path / "nursery.log", mark(folder.path))

    def start(self) -> None:
        """End what is left of an earlier supervisor's processes, then start all processes."""
        # They may hold sockets, ports and devices that the new processes need.
        left = end_all(lambda: left_of(self._folder.path), GROUP_STOP_WAIT)
        if left:
            self._say(f"ended processes left by an earlier robot of this name: {_listed(left)}")
        if self._nursery is not None:
            self._nursery.start()
        for child in self.children.values():
            self._start(child, FORK_SERVER_READY)

    def add(self, task: ProcessTask) -> None:
        """Start one more process at the next `poll`, or one that stays down once more. From any thread."""
        self._added.append(task)

    def _start_added(self) -> None:
        while self._added:
            task = self._added.popleft()
            child = self.children.get(task.name)
            if child is None:
                child = Worker(task, ProcessLog(self._folder.path / f"{task.name}.log"), HeartMonitor())
                child.is_added = True
                self.children = {**self.children, task.name: child}  # other threads iterate over it
                self._keeper.watch(task.name)
            elif child.state != "failed":
                continue
            child.crashes.clear()
            self._start(child, FORK_SERVER_READY)

    def poll(self, restarts: bool = True) -> list[Worker]:
        """Check all processes, and restart those whose wait is over. Returns those that ended since the last call."""
        fallen = []
        self._start_added()
        now = time.monotonic()
        if now >= self._chores_at:
            self._chores_at = now + CHORE_INTERVAL
            self._do_chores()
        for child in self.children.values():
            self._bound(child)
            if child.process is not None and child.process.poll() is not None:
                self._repair_folder()  # other programs read its state there, and its successor listens there
                self._reap(child, now)
                fallen.append(child)
            elif child.state == "waiting" and restarts and now >= child.again_at:
                child.restarts += 1
                self._start(child, 0.0)
            elif child.state == "running":
                self._watch(child)
                if now - child.started > HEALTHY_AFTER:
                    child.wait = RESTART_WAIT_FIRST
        if now > self._write_again:
            self._write_down()
        return fallen

    def _do_chores(self) -> None:
        """Repair the folder, and reap orphans."""
        self._repair_folder()
        reap_orphans(self._groups, self._own_pids())

    def _repair_folder(self) -> None:
        """Make the folder again if it was deleted."""
        if self._keeper.look():
            for child in self.children.values():
                child.log.link()
            self._write_down()

    def stop(self) -> None:
        """End all processes in order: those that compute, the gate, which stops the robot, the platform, the router."""
        if self._nursery is not None:
            # First, so that it forks nothing more, and does not end the others by itself.
            self._nursery.close()
        for group in (self._group(lambda roles: bool(roles) and not roles & {"gate", "platform"}),
                      self._group(lambda roles: "gate" in roles and "platform" not in roles),
                      self._group(bool),
                      self._group(lambda roles: True)):  # fmt: skip
            for child in group:
                _send(child, signal.SIGTERM)
            limit = time.monotonic() + GROUP_STOP_WAIT
            for child in group:
                self._await_end(child, limit)
        me, path = os.getpid(), self._folder.path
        left = end_all(
            lambda: [
                descendant for descendant in descendants() if (descendant.supervisor, descendant.folder) == (me, path)
            ]
        )
        reap_orphans(self._groups, self._own_pids())
        if left:
            self._say(f"ended programs that its processes had started: {_listed(left)}")
        for child in self.children.values():
            child.log.close()
            child.heart.close()
            _close(child)
        self._keeper.close()
        remove_orphans()

    def tail(self, child: Worker, lines: int = 3) -> str:
        """The last lines of a process's log."""
        return self._folder.last_words(child.task.name, lines)

    def _start(self, child: Worker, patience: float) -> None:
        """Start a process; `patience` is the longest wait for the nursery to be ready, s."""
        name, module = child.task.name, child.task.module
        heart = child.heart.path if child.task.patience is not None else ""
        known = {"parent": os.getpid(), "known": self._recall().decode(), "heart": heart}
        spec = self._hand_over(child, json.dumps({**child.task.given, **known}))
        self._keeper.forget(name)
        child.heart.reset()
        child.log.reopen()
        child.process = None
        if self._nursery is not None and module == NODE:
            child.process = self._nursery.fork(name, module, spec, child.log.shared, patience)
        if child.process is None:
            self._end_descendants(name)  # the nursery may have forked one nevertheless, and answered too late
            child.process = _popen(module, spec, child.log, {**mark(self._folder.path), PROCESS: name})
        self._groups.add(child.process.pid)
        child.started = time.monotonic()
        child.state, child.verdict = "running", ""
        self._write_down()

    def _hand_over(self, child: Worker, text: str) -> Path:
        """A file for a process to read; in memory if the system can, so that a full disk does not prevent a restart."""
        _close(child)
        if sys.platform == "linux":
            child.spec = os.memfd_create("task", os.MFD_CLOEXEC)
            with open(child.spec, "w", encoding="utf-8", closefd=False) as file:
                file.write(text)
            return Path(f"/proc/{os.getpid()}/fd/{child.spec}")
        path = self._folder.path / f"{child.task.name}.task.json"
        path.write_text(text, "utf-8")
        return path

    def _watch(self, child: Worker) -> None:
        """End a process in which a node holds the GIL for too long, computing or not. It prints its traceback."""
        patience, process = child.task.patience, child.process
        if patience is None or process is None:
            return
        silence = child.heart.silence(process.pid)
        # It was told to end and print its traceback, but a thread that sleeps in C code handles no signal.
        if silence > patience + DUMP_WAIT:
            process.kill()
        elif silence > patience and not child.verdict:
            child.verdict = f"was ended: a node held the GIL for {patience:g} s"
            process.send_signal(SEIZED)

    def _bound(self, child: Worker) -> None:
        """Keep a process's log within its bounds, and report the first loss."""
        before = child.log.cut
        child.log.bound()
        if child.log.cut > before:
            self._write_again = min(self._write_again, time.monotonic() + STATUS_RETRY_WAIT)
            if not before:
                self._say(
                    f"process {child.task.name} writes too much: the last {LARGEST_LOG >> 20} MB each are kept of "
                    f"{child.log.path} and {older_log(child.log.path).name}"
                )

    def _own_pids(self) -> set[int]:
        """Children that are reaped elsewhere than in `reap_orphans`."""
        pids = {child.process.pid for child in self.children.values() if child.process is not None}
        return pids | ({self._nursery.pid} if self._nursery is not None and self._nursery.pid else set())

    def _end_descendants(self, name: str, pid: int = -1) -> None:
        """End what a process that ended had started: it may hold the socket, port or device of its successor."""
        own = self._own_pids() | {os.getpid()}

        def left() -> list[Descendant]:
            return [
                descendant for descendant in descendants()
                if descendant.folder == self._folder.path and descendant.pid not in own
                and (pid in (descendant.group, descendant.session) or descendant.process in (name, name[:15]))
            ]  # fmt: skip

        ended = end_all(left)
        if ended:
            self._say(f"ended programs that process {name} had started: {_listed(ended)}")

    def _reap(self, child: Worker, now: float) -> None:
        assert child.process is not None
        code, pid, name = child.process.poll(), child.process.pid, child.task.name
        assert code is not None
        child.process = None
        # Before its restart: they may hold the device that it opens.
        self._end_descendants(name, pid)
        remove_orphans()
        child.why = child.verdict or _why(code)
        if place := last_crash(child.log.path) if code < 0 else "":
            child.why += f" at {place}"
        child.crashes.append(now)
        while child.crashes and now - child.crashes[0] > self._live.restart_window:
            child.crashes.popleft()
        is_unfit = child.is_added and code == UNFIT and not child.heart.has_beaten  # a restart would change nothing
        if is_unfit or len(child.crashes) > self._live.restart_limit:
            child.state = "failed"
            many = f", {len(child.crashes)} times within {self._live.restart_window:g} s"
            self._say(
                f"process {name} {child.why}{'' if is_unfit else many}: it stays down. "
                f"Its last message: {self.tail(child)}"
            )
            self._write_down()
            return
        child.state, child.again_at = "waiting", now + child.wait
        self._say(f"process {name} {child.why}; it restarts in {child.wait:g} s. Its last message: {self.tail(child)}")
        # A process that crashes at once must not take the cores from those that drive.
        child.wait = min(2 * child.wait, RESTART_WAIT_MOST)
        self._write_down()

    def _write_down(self) -> None:
        """Write the state of each process for other programs; report a failure once, and retry later."""
        fates = {
            name: Fate(
                child.process.pid if child.process else None, child.state, child.restarts, child.why, child.log.cut
            )
            for name, child in self.children.items()
        }
        try:
            self._folder.write_fates(fates)
        except OSError as error:
            self._write_again = time.monotonic() + STATUS_RETRY_WAIT
            if self._cannot_write != str(error):
                self._cannot_write = str(error)
                self._say(f"{error}; the robot continues, but `navloom doctor` does not see the state of its processes")
        else:
            self._cannot_write, self._write_again = "", math.inf

    def _group(self, belongs: Callable[[frozenset[str]], bool]) -> list[Worker]:
        return [child for child in self.children.values() if child.process is not None and belongs(child.task.roles)]

    def _await_end(self, child: Worker, limit: float) -> None:
        process = child.process
        if process is None:
            return
        try:
            process.wait(max(0.0, limit - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        child.process, child.state = None, "ended"


def _popen(module: str, spec: Path, log: ProcessLog, environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", module, str(spec)],
        stdin=subprocess.DEVNULL,
        stdout=log.file,
        stderr=log.file,
        env={**os.environ, **environment},
        # Own process group: Ctrl-C reaches only the supervisor, which ends the processes in order. Same session: when
        # the supervisor dies, the system wakes a stopped process with SIGHUP, so that it can end too.
        process_group=0,
    )


def _close(child: Worker) -> None:
    if child.spec >= 0:
        os.close(child.spec)
        child.spec = -1


def _listed(ended: Sequence[Descendant]) -> str:
    return ", ".join(map(str, ended))


def _send(child: Worker, number: signal.Signals) -> None:
    if child.process is not None:
        with contextlib.suppress(ProcessLookupError):
            child.process.send_signal(number)
            child.process.send_signal(signal.SIGCONT)  # a stopped process could not end


def _why(code: int) -> str:
    if code == -SEIZED:
        return "was ended: a node computed without releasing the GIL"
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return "ended because a node hung" if code == HUNG else f"ended with code {code}"
