"""Worker processes that run one episode at a time; workers that die or hang are replaced."""

from __future__ import annotations

import gc
import logging
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, as_completed
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from tempfile import NamedTemporaryFile
from time import monotonic
from typing import IO, Any

from navloom.crashes import crashed_at, dump_when_broken, ending_of
from navloom.errors import NavloomError
from navloom.memory import resident_bytes
from navloom.parent_process import die_with_parent

from navloom_study.episode_rows import EpisodeTask, Row, episode_row, lost_row

__all__ = ["Agenda", "PoolError", "Workers", "cores", "run_on_executor", "run_on_processes"]

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
BEAT = 1.0
"""Interval of heartbeats of an episode, s."""
HANG_AFTER = 300.0
"""Time without a heartbeat before a worker is killed, s; longer than the slowest compilation of one plugin."""
SETTLED = 16
"""Number of episodes after which a worker has loaded everything that it keeps."""
GROWTH = 256 * 2**20
"""Memory growth after that at which a worker is replaced, bytes."""
COLLECTED = 8
"""Number of episodes between garbage collections."""
STILLBORN = 3
"""Number of workers in a row that end before their first episode at which the study fails."""


class PoolError(NavloomError, RuntimeError):
    """Episodes cannot run here at all; the text says why."""

    exit_code = 1


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Agenda:
    """Episodes still to run. A worker stays in its world while episodes are left there, since it has parsed it."""

    def __init__(self, tasks: Iterable[EpisodeTask]) -> None:
        self._by_world: dict[str, deque[EpisodeTask]] = {}
        for task in tasks:
            self._by_world.setdefault(task.key.world, deque()).append(task)
        self._begun: set[str] = set()

    def __len__(self) -> int:
        return sum(map(len, self._by_world.values()))

    def take(self, world: str | None) -> EpisodeTask | None:
        """The next episode for a worker: from its world, a world that no worker has begun, or the fullest one."""
        if not self._by_world:
            return None
        if world not in self._by_world:
            fresh = [name for name in self._by_world if name not in self._begun]
            world = fresh[0] if fresh else max(self._by_world, key=lambda name: len(self._by_world[name]))
        assert world is not None
        self._begun.add(world)
        left = self._by_world[world]
        task = left.popleft()
        if not left:
            del self._by_world[world]
        return task


@dataclass(eq=False)
class EpisodeWorker:
    """One worker process, as its parent sees it."""

    process: BaseProcess
    connection: Connection
    dump: IO[str] | None = None
    is_ready: bool = False
    task: EpisodeTask | None = None
    world: str | None = None
    seen: float = field(default_factory=monotonic)
    began: float = 0.0
    episodes: int = 0
    settled: int = 0

    def has_grown(self, resident: int) -> bool:
        """Whether to replace it, judged by its resident memory, bytes, after an episode."""
        self.episodes += 1
        if self.episodes <= SETTLED:
            self.settled = max(self.settled, resident)
        return self.episodes > SETTLED and resident > self.settled + GROWTH


class Workers:
    """A pool of processes that work on an agenda.

    Args:
        agenda: Episodes to run.
        jobs: Number of processes.
        on_row: Called with the row of every episode, in the order in which they end.
        hang_after: Time without a heartbeat after which a worker is killed, s.
    """

    def __init__(
        self, agenda: Agenda, jobs: int, on_row: Callable[[Row], None], hang_after: float = HANG_AFTER
    ) -> None:
        self.agenda, self.jobs, self.on_row, self.hang_after = agenda, jobs, on_row, hang_after
        self.workers: list[EpisodeWorker] = []
        self.lost = 0
        self._stillborn = 0
        # Not fork: numba's and other libraries' threads do not survive it, and a worker must start as a clean process
        # does.
        self._context = multiprocessing.get_context("spawn")

    def run(self, idle: Callable[[], None] = lambda: None) -> None:
        """Run all episodes. `idle` is called at least twice a second.

        Raises:
            PoolError: Workers end before they are ready.
        """
        try:
            while True:
                self._fill()
                if not self.workers:
                    return
                handles: list[Any] = [handle for w in self.workers for handle in (w.connection, w.process.sentinel)]
                ready = set(wait(handles, timeout=0.5))
                # A copy: hearing of a worker's end removes it.
                for worker in list(self.workers):
                    if worker.connection in ready or worker.process.sentinel in ready:
                        self._hear(worker)
                    elif monotonic() - worker.seen > self._patience(worker):
                        self._give_up(worker)
                idle()
        finally:
            self.end()

    def end(self) -> None:
        """Kill running workers; their episodes run again when the study continues."""
        for worker in self.workers:
            # All are killed before any is joined, so they end at the same time.
            worker.process.kill()
        for worker in self.workers:
            worker.process.join()
            worker.connection.close()
        self.workers.clear()

    def _fill(self) -> None:
        """Start processes for waiting episodes, and end those without work."""
        for worker in [w for w in self.workers if w.is_ready and w.task is None]:
            self._employ(worker)
        # Those that start will each take an episode; counting them keeps the pool from starting idle processes at the
        # end.
        starting = sum(not worker.is_ready for worker in self.workers)
        for _ in range(min(self.jobs - len(self.workers), len(self.agenda) - starting)):
            self.workers.append(self._start())

    def _start(self) -> EpisodeWorker:
        ours, theirs = self._context.Pipe()
        dump = NamedTemporaryFile("r", prefix="navloom-", errors="replace")  # noqa: SIM115  (as long as the worker)
        given = (theirs, dump.name)
        process = self._context.Process(target=serve, args=given, daemon=True, name="navloom episodes")
        with _one_thread():
            process.start()
        # The worker has its own copy; with ours open, its death would not end the pipe.
        theirs.close()
        return EpisodeWorker(process, ours, dump)

    def _employ(self, worker: EpisodeWorker) -> None:
        worker.task = self.agenda.take(worker.world)
        if worker.task is None:
            self._retire(worker)
            return
        worker.world = worker.task.key.world
        worker.began = worker.seen = monotonic()
        # If the worker has died in the meantime, its end of file is noticed later, together with this task.
        with suppress(OSError):
            worker.connection.send(worker.task)

    def _hear(self, worker: EpisodeWorker) -> None:
        kind, value, resident = _word_of(worker.connection)
        worker.seen = monotonic()
        if kind == "ready":
            # One good start shows that the set-up is right, so later deaths are not counted on top of earlier ones.
            worker.is_ready, self._stillborn = True, 0
        elif kind == "row":
            worker.task = None
            self.on_row(value)
            if worker.has_grown(resident):
                self._retire(worker)
        elif kind == "dead":
            # Hearing nothing more tells no reason; the exit code does.
            self._reap(worker, "")

    def _patience(self, worker: EpisodeWorker) -> float:
        """Longest time without a heartbeat for a worker, s: the bound of episodes does not apply to imports."""
        return self.hang_after if worker.task is not None else max(self.hang_after, HANG_AFTER)

    def _give_up(self, worker: EpisodeWorker) -> None:
        worker.process.kill()
        self._reap(worker, f"hung: no sign of life for {self.hang_after:g} s, so the worker process was killed")

    def _reap(self, worker: EpisodeWorker, reason: str) -> None:
        """Remove a dead worker and report its episode as lost."""
        worker.process.join()
        worker.connection.close()
        self.workers.remove(worker)
        # Python's dump at a fatal signal, in a file, since a killed process cannot send it.
        place = crashed_at(worker.dump.read()) if worker.dump is not None else ""
        how = ending_of(worker.process.exitcode) + (f" at {place}" if place else "")
        if worker.task is not None:
            self.lost += 1
            self.on_row(lost_row(worker.task, reason or f"the worker process {how}", monotonic() - worker.began))
        elif not worker.is_ready:
            self._stillborn += 1
            if self._stillborn >= STILLBORN:
                raise PoolError(
                    f"{STILLBORN} worker processes in a row ended before they were ready; the last {how}; its error "
                    'is above; a script must start its study below `if __name__ == "__main__":`'
                )

    def _retire(self, worker: EpisodeWorker) -> None:
        with suppress(OSError):
            worker.connection.send(None)
        self.workers.remove(worker)
        # A plugin's exit handler or thread may hang.
        worker.process.join(5.0)
        if worker.process.exitcode is None:
            worker.process.kill()
            worker.process.join()
        worker.connection.close()


def _word_of(connection: Connection) -> tuple[str, Any, int]:
    """A message of a worker: "ready", "alive" or "row", with a row and its memory, bytes; "dead" at its end."""
    try:
        kind, value, resident = connection.recv() if connection.poll() else ("dead", None, 0)
    except (EOFError, OSError):
        return "dead", None, 0
    return kind, value, resident


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit processes started within to one thread each, since one episode runs on each core already."""
    before = {name: os.environ.get(name) for name in THREADS}
    # Through the environment, since the libraries read it once, when the child imports them.
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def serve(connection: Connection, dump: str) -> None:
    """Main function of a worker: take tasks and return rows until there are none left or the parent is gone."""
    parent = multiprocessing.parent_process()
    if parent is not None and parent.pid is not None:
        # The pipe ends too, but an episode that compiles or hangs does not look at it.
        die_with_parent(parent.pid, signal.SIGKILL)
    # The parent has read the same worlds and has logged their warnings.
    logging.getLogger("navloom").addHandler(logging.NullHandler())
    # Ctrl-C reaches the whole process group, but only the parent handles it. Output of plugins must not break --json.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # At the level of the descriptor: C libraries print past `sys.stdout`.
    os.dup2(2, 1)
    with suppress(OSError):
        dump_when_broken(os.open(dump, os.O_WRONLY | os.O_APPEND))
    said = 0.0

    def beat() -> None:
        nonlocal said
        # `beat` is called each tick, far more often than the parent needs a sign.
        if monotonic() - said > BEAT:
            said = monotonic()
            connection.send(("alive", None, 0))

    with suppress(EOFError, OSError):
        connection.send(("ready", None, 0))
        count = 0
        while (task := connection.recv()) is not None:
            row = episode_row(task, beat)
            count += 1
            if count % COLLECTED == 0:
                gc.collect()
            if count == SETTLED:
                # Objects that have lived this long are modules and kernels; later collections can skip them.
                gc.freeze()
            connection.send(("row", row, resident_bytes()))


def run_on_processes(
    tasks: Iterable[EpisodeTask],
    on_row: Callable[[Row], None],
    jobs: int,
    *,
    idle: Callable[[], None] = lambda: None,
    hang_after: float = HANG_AFTER,
) -> int:
    """Run episodes on processes of this machine.

    Args:
        tasks: The episodes.
        on_row: Called with the row of every episode, in the order in which they end.
        jobs: Number of processes.
        idle: Called at least twice a second.
        hang_after: Time without a heartbeat after which a worker is killed, s.

    Returns:
        Number of lost workers.

    Raises:
        PoolError: Workers end before they are ready.
    """
    workers = Workers(Agenda(tasks), jobs, on_row, hang_after)
    workers.run(idle)
    return workers.lost


def run_on_executor(tasks: Iterable[EpisodeTask], on_row: Callable[[Row], None], executor: Executor) -> None:
    """Run episodes on an executor, as that of a Dask cluster. A task that kills its workers is lost.

    Raises:
        PoolError: The executor went away; ended episodes are kept.
    """
    futures = {executor.submit(episode_row, task): task for task in tasks}
    try:
        for future in as_completed(futures):
            try:
                row = future.result()
            except CancelledError:
                raise PoolError("the cluster went away; the same command continues with what is left") from None
            except Exception as error:
                # A cluster's text about a lost task names hosts and ports, which are not reproducible.
                kind = type(error).__name__
                told = f"{kind}: {error}" if isinstance(error, ValueError) else f"the cluster lost it: {kind}"
                row = lost_row(futures[future], told)
            on_row(row)
    finally:
        for future in futures:
            # Of what has not begun: a study that fails or is interrupted must not leave the cluster working.
            future.cancel()
