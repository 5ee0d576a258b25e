"""Adds instances to a running robot: each in shadow, in a process of its own that the supervisor starts."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from navloom.config.schema import Config
from navloom.engine.system import System
from navloom.errors import NavloomError
from navloom.inputs.typed_json import from_json
from navloom.plugins.registry import close_to, nearest
from navloom.roles import FIXED

from navloom_live.hosting.network import Network
from navloom_live.hosting.node_process import Share
from navloom_live.hosting.process_tasks import NODE, node_task
from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.hosting.supervisor import Supervisor
from navloom_live.hosting.system_extension import extended, with_alternative
from navloom_live.live.live_node import Source
from navloom_live.live.requests import ADD, EXTEND, Add, Added, Alternative, Extend, Extended
from navloom_live.live.service import reply, request_bytes
from navloom_live.timing import ADDITION_ANSWER_WAIT, ADDITION_TRIES
from navloom_live.transport.idempotent_requests import Once
from navloom_live.transport.keyspace import ATTENDANT, GAINED, LINKED, SUPERVISOR, KeySpace
from navloom_live.transport.query_limits import Desk, QuestionError
from navloom_live.transport.zenoh_bus import Bus

__all__ = ["AdditionError", "Additions", "refuse_addition"]


class AdditionError(QuestionError):
    """An instance cannot be added. The text says why, and what can be done."""


@dataclass(eq=False)
class Additions:
    """Serves requests to add an instance to a robot that `navloom up` started.

    Args:
        system: The robot.
        shares: Nodes of each process of this host.
        folder, network, supervisor, bus, keys: Those of the robot.
        barrier: It runs under the barrier.
        share: A share of the robot, to copy for new processes.
        gained: Called with each extended system, and the shares with the new process.
        say: Receives messages about what happens.
    """

    system: System
    shares: Mapping[str, Sequence[Source]]
    folder: RobotFolder
    network: Network
    supervisor: Supervisor
    bus: Bus
    keys: KeySpace
    barrier: bool
    started_ns: int
    gained: Callable[[System, Mapping[str, Sequence[Source]], Source], None]
    say: Callable[[str], None]
    _added: dict[Source, str] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def offer(self) -> None:
        """Declare the service."""
        key = self.keys.process(SUPERVISOR, ADD.name)
        self.bus.serve(key, Desk().window(ADD.name, reply(key, ADD, self._answer, Once())))
        self.bus.announce(self.keys.process(SUPERVISOR, LINKED))

    def _answer(self, asked: Add) -> Added:
        """Add an instance, or report on one that was added."""
        source = asked.role, asked.instance
        with self._lock:
            is_new = source not in self.system.parts
            if is_new:
                self._add(source)
        child = self.supervisor.children.get(self._added.get(source, ""))
        if child is not None and child.state == "failed" and asked.again:
            self.supervisor.add(child.task)
            child = None
        if child is None:
            return Added(is_new)
        return Added(is_new, child.state, child.why, self.supervisor.tail(child, 1) if child.why else "")

    def _add(self, source: Source) -> None:
        role, name = source
        refuse_addition(self.system, source, self.barrier)
        process = _process_of(source, self.system.config)
        table = Alternative(role, name, name, True)
        try:
            loaded = with_alternative(self.system.loaded, vars(table), process)
            system = extended(self.system, loaded, source)
        except NavloomError as error:
            raise AdditionError(_plain(str(error), self.system, source)) from None
        shares = {**self.shares, process: (source,)}
        # The running processes open no further links: the new one connects to all of them.
        link = self.network.added(self.folder, shares, process)
        # A recorder must not miss the first messages of the new process, or its steps cannot be replayed.
        is_recorded = bool(self.bus.alive(self.keys.process(ATTENDANT, LINKED), 0.5))
        share = Share(process, (source,), link, False, self.started_ns, is_recorded, joins=True)
        for child in self.supervisor.children.values():  # a process that restarts from now on knows the instance
            if child.task.module == NODE:
                child.task = replace(child.task, given={**child.task.given, "loaded": loaded.to_json()})
        # Before the process starts: its first messages must find readers.
        self._extend_processes(Extend(table, process), loaded.sha256())
        self.bus.bring_here("/".join(source), f"process/{process}")
        self.system, self.shares, self._added[source] = system, shares, process
        self.gained(system, shares, source)
        self.bus.announce(self.keys.process(process, GAINED))
        self.supervisor.add(node_task(loaded, share))
        self.say(f"{role}: starting {name} in shadow")

    def _extend_processes(self, asked: Extend, sha256: str) -> None:
        """Let every running process know of the instance. Raises AdditionError if one does not answer."""
        for process in self.shares:
            answer = self._ask(process, asked)
            # All processes must compute the same config, since each derives its wiring from it.
            if isinstance(answer, str) or answer.config_sha256 != sha256:
                why = answer if isinstance(answer, str) and answer else "it does not answer"
                raise AdditionError(
                    f"process {process} cannot take in {asked.alternative.role} {asked.alternative.name}: {why}; "
                    "nothing was started, try again"
                )

    def _ask(self, process: str, asked: Extend) -> Extended | str:
        """The answer of a process, or the reason of its refusal, empty if it does not answer."""
        refusal, data = "", request_bytes(asked)
        for _ in range(ADDITION_TRIES):
            for answer in self.bus.ask(self.keys.process(process, EXTEND.name), data, ADDITION_ANSWER_WAIT):
                if not answer.refusal:
                    return from_json(EXTEND.answered, answer.data)
                refusal = answer.refusal
            # A process that restarts answers again within a second or two.
            time.sleep(0.2)
        return refusal


def refuse_addition(system: System, source: Source, barrier: bool) -> None:
    """Refuse an instance that this robot cannot gain while it runs.

    Raises:
        AdditionError: With the reason, and the command that starts the robot with it.
    """
    role, name = source
    start = f"start it with `navloom up {system.loaded.name} --shadow {role}={name}"
    roles = sorted({owner for owner, _ in system.parts} - FIXED)
    if role not in roles:
        raise AdditionError(f"{role!r} is no role that can be swapped{nearest(role, roles)}")
    if barrier:
        raise AdditionError(
            f"{role} {name}: a robot under --barrier gains no instance, since each node waits for those that it "
            f"started with: {start} --barrier`"
        )
    if len(system.config.live.hosts) > 1:
        raise AdditionError(
            f"{role} {name}: a robot on several hosts gains no instance while it runs: {start} --host NAME` on each "
            "host"
        )


def _process_of(source: Source, config: Config) -> str:
    """A free name for the process of an added instance."""
    name = re.sub(r"[^A-Za-z0-9_-]", "-", "-".join(source))
    while name in config.live.processes:
        name += "-2"
    return name


def _plain(text: str, system: System, source: Source) -> str:
    """Why an instance cannot be added: without the place of its table, which is in no file."""
    role, name = source
    there = [known for owner, known in system.parts if owner == role]
    place = re.compile(rf"^.*?alternative\.{len(system.config.alternative)}\.")
    close = close_to(name, there)
    lines = "; ".join(place.sub("", line) for line in text.splitlines())
    has = f"there is no {role} {name!r}; there are {', '.join(there)}{close}"
    return f"{has}{' ' if close else '; '}it cannot be added: {lines}"
