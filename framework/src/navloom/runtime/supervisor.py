"""Starts a robot's processes, starts those that crash again, and leaves none behind."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from navloom.config import Loaded
from navloom.config.schema import LiveTable
from navloom.runtime.directory import Fate, RobotFolder
from navloom.runtime.links import Link
from navloom.runtime.node_main import share_to_json
from navloom.runtime.node_process import HUNG, Share
from navloom.runtime.nursery import READY, Born, Nursery
from navloom.runtime.process import SEIZED, link_to_json

__all__ = ["Child", "Supervisor", "Task", "node_task", "router_task"]

NODE = "navloom.runtime.node_main"
FIRST_WAIT, LONGEST_WAIT = 0.1, 5.0
"""s before the first restart, and at most before a later one."""
HEALTHY = 5.0
"""s a process must run for its next crash to count as a first one."""
STOP_WAIT = 1.0
"""s each group of processes may take to end in order, before it is killed."""


@dataclass(frozen=True)
class Task:
    """What a process is started with.

    Attributes:
        name: Of the process.
        module: Python module that is run with the path of a JSON file.
        given: What the file holds.
        roles: Of the nodes it runs, for the order in which processes end.
    """

    name: str
    module: str
    given: Mapping[str, Any]
    roles: frozenset[str] = frozenset()


def node_task(loaded: Loaded, share: Share) -> Task:
    """The process of a share."""
    given = {"loaded": loaded.to_json(), "share": share_to_json(share)}
    return Task(share.name, NODE, given, frozenset(role for role, _ in share.sources))


def router_task(link: Link) -> Task:
    """The process of a router."""
    return Task("router", "navloom.runtime.router_main", {"link": link_to_json(link)})


@dataclass(eq=False)
class Child:
    """A process and its fate.

    Attributes:
        task: What it does.
        process: It, while there is one.
        crashes: Times of those within the window, s, monotonic.
        restarts: How often it was started again.
        state: starting, running, waiting (for its restart), failed or ended.
        why: How it ended last.
    """

    task: Task
    process: subprocess.Popen[bytes] | Born | None = None
    started: float = 0.0
    again_at: float = 0.0
    wait: float = FIRST_WAIT
    crashes: deque[float] = field(default_factory=deque)
    restarts: int = 0
    state: str = "starting"
    why: str = ""


class Supervisor:
    """Keeps the processes of one host running.

    Args:
        live: Limits of restarts.
        folder: The robot's.
        tasks: What each process does.
        say: Told what happens to them.
        recall: What a process that is started must know of the time before, as JSON.
    """

    def __init__(
        self,
        live: LiveTable,
        folder: RobotFolder,
        tasks: Sequence[Task],
        say: Callable[[str], None],
        recall: Callable[[], bytes] = bytes,
    ) -> None:
        self._live, self._folder, self._say, self._recall = live, folder, say, recall
        self.children = {task.name: Child(task) for task in tasks}
        self._nursery: Nursery | None = None
        if Nursery.is_possible() and any(task.module == NODE for task in tasks):
            self._nursery = Nursery(folder.path / "nursery.log")

    def start(self) -> None:
        """Start all of them."""
        if self._nursery is not None:
            self._nursery.start()
        for child in self.children.values():
            self._start(child, READY)

    def poll(self, restarts: bool = True) -> list[Child]:
        """Look after them: those that ended by themselves since the last look; they are started again in due time."""
        fallen = []
        now = time.monotonic()
        for child in self.children.values():
            if child.process is not None and child.process.poll() is not None:
                self._bury(child, now)
                fallen.append(child)
            elif child.state == "waiting" and restarts and now >= child.again_at:
                child.restarts += 1
                self._start(child, 0.0)
            elif child.state == "running" and now - child.started > HEALTHY:
                child.wait = FIRST_WAIT
        return fallen

    def stop(self) -> None:
        """End them in order: those that compute, the gate, which stops the robot, the platform, and the router."""
        if self._nursery is not None:
            self._nursery.close()
        for group in (self._group(lambda roles: bool(roles) and not roles & {"gate", "platform"}),
                      self._group(lambda roles: "gate" in roles and "platform" not in roles),
                      self._group(bool),
                      self._group(lambda roles: True)):  # fmt: skip
            for child in group:
                _send(child, signal.SIGTERM)
            limit = time.monotonic() + STOP_WAIT
            for child in group:
                self._await_end(child, limit)

    def tail(self, child: Child, lines: int = 3) -> str:
        """The last lines a process wrote."""
        return self._folder.last_words(child.task.name, lines)

    def _start(self, child: Child, patience: float) -> None:
        """Start a process; patience is the s to wait for the nursery to be ready."""
        name, module = child.task.name, child.task.module
        spec = self._folder.path / f"{name}.task.json"
        spec.write_text(
            json.dumps({**child.task.given, "parent": os.getpid(), "known": self._recall().decode()}), "utf-8"
        )
        log = self._folder.path / f"{name}.log"
        if not child.restarts:
            log.write_bytes(b"")
        child.process = None
        if self._nursery is not None and module == NODE:
            child.process = self._nursery.bear(name, module, spec, log, patience)
        if child.process is None:
            child.process = _popen(module, spec, log)
        child.started = time.monotonic()
        child.state = "running"
        self._write_down()

    def _bury(self, child: Child, now: float) -> None:
        assert child.process is not None
        code = child.process.poll()
        assert code is not None
        child.process = None
        child.why = _why(code)
        child.crashes.append(now)
        while child.crashes and now - child.crashes[0] > self._live.restart_window:
            child.crashes.popleft()
        name = child.task.name
        if len(child.crashes) > self._live.restart_limit:
            child.state = "failed"
            self._say(
                f"process {name} {child.why}, {len(child.crashes)} times within {self._live.restart_window:g} s: "
                f"left down. It said last: {self.tail(child)}"
            )
            self._write_down()
            return
        child.state, child.again_at = "waiting", now + child.wait
        self._say(
            f"process {name} {child.why}; it is started again in {child.wait:g} s. It said last: {self.tail(child)}"
        )
        child.wait = min(2 * child.wait, LONGEST_WAIT)
        self._write_down()

    def _write_down(self) -> None:
        """Leave for who looks what has become of each process."""
        self._folder.write_fates(
            {
                name: Fate(child.process.pid if child.process else None, child.state, child.restarts, child.why)
                for name, child in self.children.items()
            }
        )

    def _group(self, belongs: Callable[[frozenset[str]], bool]) -> list[Child]:
        return [child for child in self.children.values() if child.process is not None and belongs(child.task.roles)]

    def _await_end(self, child: Child, limit: float) -> None:
        process = child.process
        if process is None:
            return
        try:
            process.wait(max(0.0, limit - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        child.process, child.state = None, "ended"


def _popen(module: str, spec: Path, log: Path) -> subprocess.Popen[bytes]:
    with log.open("ab") as file:
        return subprocess.Popen(
            [sys.executable, "-m", module, str(spec)],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=file,
            # A group of its own: Ctrl-C reaches the supervisor alone, which ends them in order. The same session:
            # when the supervisor dies, the system wakes a stopped one with SIGHUP, so that it can end, too.
            process_group=0,
        )


def _send(child: Child, number: signal.Signals) -> None:
    if child.process is not None:
        with contextlib.suppress(ProcessLookupError):
            child.process.send_signal(number)
            child.process.send_signal(signal.SIGCONT)  # one that was stopped could not end


def _why(code: int) -> str:
    if code == -SEIZED:
        return "was ended: a node computed without ever letting go of Python"
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return "gave up a node that hangs" if code == HUNG else f"ended with code {code}"
