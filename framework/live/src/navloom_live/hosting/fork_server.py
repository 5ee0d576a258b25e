"""The nursery: a process that has imported what all node processes need, and from which they are forked.

Importing takes longer than the rest of a process's start, so a process that died is back in a fraction of the time.
The nursery itself has no threads, imports no plugin and joins no network. The processes that it forks become children
of the supervisor: they survive the nursery's death, and until it is restarted, processes start without it.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

from navloom.crashes import dump_when_broken

from navloom_live.hosting.descendants import MARK, PROCESS, Descendant, descendants, end_all
from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.hosting.shared_memory import remove_orphans
from navloom_live.timing import ORPHAN_SHUTDOWN_LIMIT

__all__ = ["ForkedProcess", "Nursery", "main"]

PR_SET_CHILD_SUBREAPER, PR_SET_NAME = 36, 15
FORK_LIMIT = 5.0
"""Longest time of a fork, s; it normally takes some ms."""
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of the nursery: libraries must not start threads before the fork."""


class ForkedProcess:
    """A process that was forked from the nursery and is this process's child, with the needed part of `Popen`."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Exit code, or minus the signal that ended it; None while it runs."""
        if self.returncode is None:
            try:
                pid, status = os.waitpid(self.pid, os.WNOHANG)
            except ChildProcessError:  # it was already reaped elsewhere
                self.returncode = 1
            else:
                self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end. Raises subprocess.TimeoutExpired after `timeout`, s."""
        limit = None if timeout is None else time.monotonic() + timeout
        while self.poll() is None:
            if limit is not None and time.monotonic() > limit:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
            time.sleep(0.005)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """SIGKILL."""
        self.send_signal(signal.SIGKILL)


class Nursery:
    """The supervisor's side of the nursery.

    Args:
        log: Log file of the nursery.
        environment: Further environment variables for it, and so for every process forked from it.
    """

    def __init__(self, log: Path, environment: Mapping[str, str] = {}) -> None:
        self._log, self._environment = log, environment
        self._process: subprocess.Popen[bytes] | None = None
        self._line: socket.socket | None = None
        self._is_ready = False

    @staticmethod
    def is_possible() -> bool:
        """Whether the system can make another process's fork a child of this process: only Linux can."""
        return sys.platform == "linux"

    def start(self) -> None:
        """Start the nursery; it is ready a little later."""
        # Orphans below this process become its children: so are the double forks of the nursery.
        if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0):
            return
        ours, theirs = socket.socketpair()
        with theirs, _writable(self._log) as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "navloom_live.hosting.fork_server", str(theirs.fileno()), str(os.getpid())],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                pass_fds=[theirs.fileno()],
                # Ctrl-C must reach the supervisor alone, which ends the processes in order.
                process_group=0,
                env={**os.environ, **ONE_THREAD, **self._environment},
            )
        self._line, self._is_ready = ours, False

    @property
    def pid(self) -> int | None:
        """ID of the nursery's process; None while there is none."""
        return None if self._process is None else self._process.pid

    def fork(self, name: str, module: str, spec: Path, log: Path, patience: float) -> ForkedProcess | None:
        """Fork a process that runs `module.main()` with a file's path; None if it must be started without the nursery.

        Args:
            name: Name of the process in process lists.
            module: Module whose `main` returns an exit code and reads the path from `sys.argv[1]`.
            spec: The file.
            log: File to which its output is appended.
            patience: How long to wait for the nursery to be ready, s.
        """
        if not self._wait_ready(patience) or self._line is None:
            return None
        order = {"name": name, "module": module, "spec": str(spec), "log": str(log)}
        try:
            # A nursery that hangs must not hold up the supervisor, which restarts processes.
            self._line.settimeout(FORK_LIMIT)
            self._line.sendall(json.dumps(order).encode() + b"\n")
            return ForkedProcess(int(self._line.recv(32)))
        except (OSError, ValueError):
            self.close()
            return None

    def close(self) -> None:
        """End the nursery; processes forked from it continue."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
        if self._line is not None:
            self._line.close()
            self._line = None

    def _wait_ready(self, patience: float) -> bool:
        if self._process is None or self._process.poll() is not None:
            self.close()
            self.start()
        if not self._is_ready and self._line is not None:
            self._line.settimeout(max(0.001, patience))
            with contextlib.suppress(OSError):
                self._is_ready = self._line.recv(1) == b"+"
        return self._is_ready


def main() -> None:
    """Fork a process for each line received, until the supervisor is gone; then end all forked processes."""
    dump_when_broken()
    supervisor = int(sys.argv[2])
    forked: list[int] = []
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line = socket.socket(fileno=int(sys.argv[1]))
    _import_all()
    # Frozen objects are left alone by later collections, so that forks keep sharing their pages.
    gc.collect()
    gc.freeze()
    with contextlib.suppress(OSError):
        line.sendall(b"+")
        # Ends when the supervisor's end of the line closes, that is, also when it is killed.
        for order in line.makefile("rb"):
            forked.append(_fork_child(json.loads(order), line, supervisor))
            line.sendall(b"%d" % forked[-1])
    # The supervisor is dead: nobody else would stop the robot's processes.
    _end(forked)
    end_all(lambda: _others(supervisor))
    remove_orphans()
    _clear_sockets()


def _others(supervisor: int) -> list[Descendant]:
    """Processes that plugins started below the supervisor and that still run."""
    if MARK not in os.environ:
        return []
    return [
        descendant
        for descendant in descendants()
        if descendant.supervisor == supervisor and descendant.pid != os.getpid()
    ]


def _clear_sockets() -> None:
    """Remove the robot's sockets, unless another supervisor has the robot by now. Other files stay for `doctor`."""
    _, _, path = os.environ.get(MARK, "").partition(":")
    realm, _, robot = Path(path).name.partition(".")
    folder = RobotFolder(realm, robot)
    if path and folder.path == Path(path) and folder.path.is_dir() and folder.lock():
        folder.clear_sockets()
        folder.unlock()


def _writable(path: Path) -> IO[bytes]:
    """The file, opened for writing; the null device if that fails."""
    try:
        return path.open("wb")
    except OSError:
        return open(os.devnull, "wb")


def _end(forked: Sequence[int]) -> None:
    """End processes: with SIGTERM (and SIGCONT, since a stopped process receives no signal), then with SIGKILL."""
    for number in (signal.SIGTERM, signal.SIGCONT):
        _send(forked, number)
    limit = time.monotonic() + ORPHAN_SHUTDOWN_LIMIT
    while any(map(_is_there, forked)) and time.monotonic() < limit:
        time.sleep(0.02)
    _send(forked, signal.SIGKILL)


def _send(forked: Sequence[int], number: int) -> None:
    for pid in filter(_is_there, forked):
        with contextlib.suppress(OSError):
            os.kill(pid, number)


def _is_there(pid: int) -> bool:
    """Whether a process ID still belongs to a process forked here."""
    try:
        # The ID may belong to another process by now; forked ones lead their group in this session.
        return os.getpgid(pid) == pid and os.getsid(pid) == os.getsid(0)
    except OSError:
        return False


def _import_all() -> None:
    import scipy.ndimage  # noqa: F401

    import navloom_live.hosting.node_main  # noqa: F401


def _fork_child(order: dict[str, str], line: socket.socket, supervisor: int) -> int:
    """Fork twice, so that the second process becomes a child of the supervisor; returns its process ID."""
    reading, writing = os.pipe()
    first = os.fork()
    if first == 0:
        # By hand and not by `multiprocessing.forkserver`, whose children are no children of the supervisor and outlive
        # its SIGKILL.
        second = os.fork()
        if second:
            os.setpgid(second, second)  # before any other process knows its ID
            os.write(writing, b"%d" % second)
            os._exit(0)
        for number in (line.fileno(), reading, writing):
            os.close(number)
        _run_child(order, supervisor)
    os.waitpid(first, 0)
    pid = int(os.read(reading, 32))
    os.close(reading)
    os.close(writing)
    return pid


def _run_child(order: dict[str, str], supervisor: int) -> None:
    """In the new process: run what was ordered, and exit."""
    limit = time.monotonic() + FORK_LIMIT
    # The first fork must be gone before the system hands this one to the subreaper; only then may `die_with_parent`
    # look at its parent.
    while os.getppid() != supervisor and time.monotonic() < limit:
        time.sleep(0.001)
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with open(order["log"], "ab") as log:
        _take_over(log)
    ctypes.CDLL(None).prctl(PR_SET_NAME, order["name"].encode()[:15], 0, 0, 0)
    sys.argv = [order["module"], order["spec"]]
    os.environ[PROCESS] = order["name"]
    code = 1
    try:
        code = importlib.import_module(order["module"]).main()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        # Python's shutdown would run the nursery's own exit handlers.
        os._exit(code)


def _take_over(log: IO[bytes]) -> None:
    for number in (1, 2):
        os.dup2(log.fileno(), number)


if __name__ == "__main__":
    main()
