"""The members of a fleet that one process drives, and the processes that drive some of them.

A tick of the fleet needs one exchange: what moves goes to each process, and the truths of its members come back.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from multiprocessing.connection import Connection
from tempfile import NamedTemporaryFile
from typing import IO, Any

from navloom.config import Loaded
from navloom.crashes import crashed_at, dump_when_broken, ending_of
from navloom.engine.lockstep import Observer
from navloom.engine.plugin_factory import make_plugins
from navloom.errors import NavloomError
from navloom.messages import Bodies, Truth
from navloom.parent_process import die_with_parent
from navloom.runs.episode import Drive, Episode
from navloom.runs.result_folder import Draft, TraceFile
from navloom.runs.shared_drives import drives_of

__all__ = ["FleetError", "Moved", "Share", "ShareProcess"]

Moved = tuple[str, Truth | None, bool]
"""Name of a member, its newest truth, None before the first, and whether its run has ended."""
PATIENCE = 5.0
"""How long a process may take to end by itself, s; a thread or an exit handler of a plugin may hang."""


class FleetError(NavloomError, RuntimeError):
    """A process that drives members of a fleet has ended before its run."""

    exit_code = 1


class Share(AbstractContextManager["Share"]):
    """Members that this process drives.

    Args:
        drives: Their robots, by name.
        traces: File for the trace of each member, by name.
        say: Receives progress of the preparation.
        reads: Streams that metrics need, `(role or node, port)`, of each member.
        begin: Notifies the observers of a robot's run of its start, and returns those that want messages.
    """

    def __init__(
        self,
        drives: Mapping[str, Drive],
        traces: Mapping[str, IO[bytes]],
        say: Callable[[str], None],
        reads: Iterable[tuple[str, str]],
        begin: Callable[[Drive], Sequence[Observer]],
    ) -> None:
        self.drives, self._driving, self._begin = drives, dict(drives), begin
        self._traces, self._say, self._reads = traces, say, list(reads)
        self._within = ExitStack()

    def __enter__(self) -> Share:
        with ExitStack() as within:
            for name, drive in self.drives.items():
                within.enter_context(drive)
                make_plugins(drive.system, self._say)
                executor = drive.connect(self._begin(drive), self._traces.get(name), reads=self._reads)
                # Also after an error or Ctrl-C: the trace up to there shows what led to it.
                within.callback(executor.trace.flush)
            self._within = within.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._within.close()

    def tick(self, number: int, bodies: Bodies) -> list[Moved]:
        """Make one tick of the members that still drive, which first read what moves."""
        moved: list[Moved] = []
        when = (number, bodies.stamp_ns, bodies.stamp_ns, 0)
        for name, drive in list(self._driving.items()):
            executor = drive.executor
            slot = executor.active("world").slots["bodies"]
            slot.put(bodies, slot.sequence + 1, when, number)
            is_over = executor.tick(number) or number + 1 >= drive.system.longest_run
            truth = executor.active("platform").slots["truth"].message
            assert truth is None or isinstance(truth, Truth)
            moved.append((name, truth, is_over))
            if is_over:
                del self._driving[name]
        return moved

    def finish(self) -> dict[str, Episode]:
        """The finished runs, by name."""
        for drive in self.drives.values():
            drive.executor.finish(sum(drive.executor.log.tick_ns))
        return {name: drive.episode() for name, drive in self.drives.items()}


class ShareProcess(AbstractContextManager["ShareProcess"]):
    """A process that drives members; within a `with` statement it runs.

    Args:
        drives: Their robots, by name; they are made again there.
        traces: File for the trace of each member, by name: one that has a path, since the process opens it again.
        reads: See `Share`.
    """

    def __init__(
        self, drives: Mapping[str, Drive], traces: Mapping[str, IO[bytes]], reads: Iterable[tuple[str, str]]
    ) -> None:
        self._drives = drives
        self._traces = {name: file for name, file in traces.items() if name in drives}
        self._reads, self._is_ready = list(reads), False

    def __enter__(self) -> ShareProcess:
        # Not fork: numba's and other libraries' threads do not survive it.
        context = multiprocessing.get_context("spawn")
        self._dump = NamedTemporaryFile("r", prefix="navloom-", errors="replace")
        self._connection, theirs = context.Pipe()
        members = [drive.system.loaded for drive in self._drives.values()]
        paths = {name: os.fspath(file.name) for name, file in self._traces.items()}
        given = (theirs, members, paths, self._reads, self._dump.name)
        self._process = context.Process(target=serve, args=given, daemon=True, name="navloom fleet")
        # Ctrl-C reaches the whole process group, but only the parent handles it: blocked from the first instruction on.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        # The process has its own copy; with ours open, its death would not end the pipe.
        theirs.close()
        return self

    def __exit__(self, *error: Any) -> None:
        # At the end of the pipe the process flushes its traces and ends.
        self._connection.close()
        self._process.join(PATIENCE)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()
        self._dump.close()

    def await_ready(self) -> None:
        """Wait until its plugins are made. Raises what they refuse."""
        self._hear()
        self._is_ready = True

    def begin_tick(self, number: int, bodies: Bodies) -> None:
        """Let it make a tick; see `Share.tick`. `end_tick` waits for it."""
        # If the process has died in the meantime, `end_tick` says so.
        with suppress(OSError):
            self._connection.send((number, bodies))

    def end_tick(self) -> list[Moved]:
        """What its members did."""
        moved: list[Moved] = self._hear()
        return moved

    def finish(self, said: Sequence[Bodies]) -> dict[str, Episode]:
        """The finished runs, by name; `said`: what moved in each tick."""
        with suppress(OSError):
            self._connection.send(None)
        ended, failures = self._hear()
        for name, failure in failures.items():
            file = self._traces[name]
            if isinstance(file, TraceFile):
                file.failure = failure
        episodes = {}
        for name, (log, recorder, shadows, warnings) in ended.items():
            recorder.bodies.extend(said[: log.ticks])
            episodes[name] = Episode(self._drives[name].system, log, recorder, shadows, warnings)
        return episodes

    def _hear(self) -> Any:
        try:
            error, value = self._connection.recv()
        except (EOFError, OSError):
            raise FleetError(self._death()) from None
        if error is not None:
            raise error
        return value

    def _death(self) -> str:
        self._process.join(PATIENCE)
        place = crashed_at(self._dump.read())
        how = ending_of(self._process.exitcode) + (f" at {place}" if place else "")
        text = f"fleet: the process of {', '.join(self._drives)} {how}"
        if self._is_ready:
            return f"{text}: the run has no result"
        return f'{text} before it was ready: a script must start its run below `if __name__ == "__main__":`'


def serve(
    connection: Connection, members: Sequence[Loaded], paths: Mapping[str, str], reads: Sequence[Any], dump: str
) -> None:
    """Main function of a process: drive members tick by tick, until the parent has the result or is gone."""
    parent = multiprocessing.parent_process()
    if parent is not None and parent.pid is not None:
        die_with_parent(parent.pid, signal.SIGKILL)
    # The parent has read the same worlds and has logged their warnings.
    logging.getLogger("navloom").addHandler(logging.NullHandler())
    # Output of plugins must not break --json. By descriptor, since C libraries print past `sys.stdout`.
    os.dup2(2, 1)
    with suppress(OSError):
        dump_when_broken(os.open(dump, os.O_WRONLY | os.O_APPEND))
    with suppress(EOFError, OSError):
        try:
            _drive(connection, members, {name: Draft(path) for name, path in paths.items()}, reads)
        except NavloomError as error:
            connection.send((error, None))


def _drive(
    connection: Connection, members: Sequence[Loaded], traces: Mapping[str, Draft], reads: Sequence[Any]
) -> None:
    with Share(drives_of(members), traces, lambda text: None, reads, lambda drive: ()) as share:
        connection.send((None, "ready"))
        while (given := connection.recv()) is not None:
            connection.send((None, share.tick(*given)))
        ended = {}
        for name, episode in share.finish().items():
            episode.recorder.bodies.clear()  # the parent has them
            ended[name] = (episode.log, episode.recorder, episode.shadows, episode.warnings)
    connection.send((None, (ended, {name: trace.failure for name, trace in traces.items()})))
