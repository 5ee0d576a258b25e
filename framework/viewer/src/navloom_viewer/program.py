"""The viewer's program: started on the loopback interface only, or found where it already runs."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import IO
from urllib.parse import urlsplit

from navloom_viewer.viewer_errors import ViewerError, ViewerLost, need_rerun

__all__ = ["HOST", "Program", "address_of", "claimed_port", "is_up", "need_display"]

HOST = "127.0.0.1"
PORT, WEB_PORT = 9876, 9090
TRIES = 20
"""Number of ports that are tried if the wanted one is taken."""
STARTED = 30.0
"""Longest startup of a viewer until it listens, s."""
WINDOW = 2.0
"""Time within which a viewer that cannot open a window ends, s; it listens before that."""
WINDOWLESS = {"--headless", "--serve-grpc"}
"""Options of the viewer's program with which it opens no window."""
SERVED, KEPT = "--web serves the viewer to a browser", "--rerun F.rrd keeps what it would show in a file"
LAUNCH = """
import ctypes, os, signal, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG
if os.getppid() != int(sys.argv[1]):  # the parent died before the call
    sys.exit(1)
os.execv(sys.argv[2], sys.argv[2:])
"""
"""Python source that runs a program that ends with its parent process, even if the parent is killed."""
MEMORY = "1GiB"
"""Memory limit of a viewer, beyond which it drops the oldest data; it uses about twice that."""


def address_of(url: str) -> tuple[str, int]:
    """Host and port from a viewer's URL, as rerun+http://127.0.0.1:9876/proxy, or from HOST:PORT.

    Raises:
        ViewerError: Neither of them.
    """
    parts = urlsplit(url if "://" in url else f"rerun+http://{url}/proxy")
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or port is None or parts.path.rstrip("/") != "/proxy":
        raise ViewerError(f"--viewer {url}: expected rerun+http://HOST:PORT/proxy, or HOST:PORT, as {HOST}:{PORT}")
    return host, port


def is_up(host: str, port: int, patience: float = 0.3) -> bool:
    """Whether a program listens there."""
    try:
        socket.create_connection((host, port), patience).close()
    except OSError:
        return False
    return True


@contextmanager
def claimed_port(wanted: int) -> Iterator[int]:
    """Reserve a loopback port, the wanted one if it is free, else any, for the duration of a `with` statement.

    A program takes a while until it listens. Until then the UDP port of the same number, which is otherwise unused,
    marks the port as taken. Without this, two viewers started at once would share a port and show both runs.

    Raises:
        ViewerError: No port is free.
    """
    for port in (wanted, *[0] * TRIES):
        with socket.socket(type=socket.SOCK_DGRAM) as twin, socket.socket() as probe:
            # The port of a viewer that has just ended is still in TIME_WAIT, but can be used.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                twin.bind((HOST, port))
                port = twin.getsockname()[1]
                probe.bind((HOST, port))
            except OSError:
                continue
            # The viewer must be able to bind it itself; the twin stays.
            probe.close()
            yield port
            return
    raise ViewerError("no port of the loopback is free")


def need_display(keeps: bool = True) -> None:
    """Raise ViewerError that names the alternatives if no window can be opened; only Linux tells that in advance.

    Args:
        keeps: Whether a file is an alternative too.
    """
    names = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in names):
        ways = f"{SERVED}, {KEPT}" if keeps else SERVED
        raise ViewerError(f"there is no display here, neither DISPLAY nor WAYLAND_DISPLAY is set: {ways}")


class Program:
    """A viewer started by this process. A window stays open when the command ends; a web server ends with it.

    Args:
        web: Serve it to a browser instead of opening a window.
        files: Files to open at the start.
        options: Further options of the program, for tests: `--headless`.

    Raises:
        ViewerError: The viewer is not installed, or ended before it listened.
    """

    def __init__(self, web: bool = False, files: Sequence[Path] = (), options: Sequence[str] = ()) -> None:
        need_rerun()
        self._opens_window = not web and WINDOWLESS.isdisjoint(options)
        binary = Path(str(import_module("rerun_cli").__file__)).parent / ("rerun.exe" if os.name == "nt" else "rerun")
        # A file, not a pipe: nobody reads while the viewer runs, and a full pipe would stop it.
        self._words: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the program
        with claimed_port(PORT) as self.port, claimed_port(WEB_PORT) as web_port:
            self.web_port = web_port if web else None
            self._start(binary, files, options)
            self._await_start()
        self._window_by = time.monotonic() + WINDOW

    def _start(self, binary: Path, files: Sequence[Path], options: Sequence[str]) -> None:
        command = [
            str(binary), "--bind", HOST, "--port", str(self.port), "--memory-limit", MEMORY,
            "--server-memory-limit", "256MiB", "--hide-welcome-screen", *options,
        ]  # fmt: skip
        if self.web_port is not None:
            command += ["--serve-web", "--web-viewer-port", str(self.web_port)]
            command = [sys.executable, "-c", LAUNCH, str(os.getpid()), *command]
        # CI=1 turns off the viewer's usage statistics: a robot's host must not send any.
        environment = {**os.environ, "CI": "1"}
        # A separate process group, so that Ctrl-C ends the command but not the viewer.
        self.process = subprocess.Popen(
            [*command, *map(str, files)], stdin=subprocess.DEVNULL, stdout=self._words, stderr=self._words,
            start_new_session=True, env=environment,
        )  # fmt: skip

    @property
    def url(self) -> str:
        """URL to send drawings to."""
        return f"rerun+http://{HOST}:{self.port}/proxy"

    @property
    def page(self) -> str | None:
        """URL for a browser; None for a window."""
        if self.web_port is None:
            return None
        return f"http://{HOST}:{self.web_port}?url=rerun%2Bhttp%3A%2F%2F{HOST}%3A{self.port}%2Fproxy"

    def await_window(self) -> None:
        """Wait long enough that a viewer without a window would have ended.

        Raises:
            ViewerError: The viewer ended.
        """
        if not self._opens_window:
            return
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(max(0.0, self._window_by - time.monotonic()))
        if self.process.poll():
            # Only with an exit code: a window that was closed by its user ends with 0.
            raise ViewerError(self._no_window())

    def _no_window(self) -> str:
        """Message: why there is no window, and what to do."""
        return f"the viewer opens no window: {self._last_words()}; {SERVED}, {KEPT}"

    def leave(self, say: Callable[[str], None], serves: bool = True) -> None:
        """Leave a window open; for a web server, serve until Ctrl-C if `serves`, then end it.

        Raises:
            ViewerLost: The viewer ended with an error before.
        """
        if self.process.poll():
            raise ViewerLost(f"the viewer ended: {self._last_words()}")
        if self.page is None:
            return
        if serves:
            # The line within it too: who reads it may press Ctrl-C before the wait begins.
            with contextlib.suppress(KeyboardInterrupt):
                say(f"the viewer is served at {self.page} until Ctrl-C")
                self.process.wait()
        self.end()

    def end(self) -> None:
        """Close it."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(5.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self._words.close()

    def _await_start(self) -> None:
        limit = time.monotonic() + STARTED
        while not self._listens():
            if self.process.poll() is not None:
                raise ViewerError(
                    self._no_window() if self._opens_window else f"the viewer did not start: {self._last_words()}"
                )
            if time.monotonic() > limit:
                self.end()
                raise ViewerError(f"the viewer does not listen {STARTED:g} s after its start")
            time.sleep(0.05)

    def _listens(self) -> bool:
        """Whether it listens for drawings and, as a web server, on the port of the page, which opens later."""
        return is_up(HOST, self.port) and (self.web_port is None or is_up(HOST, self.web_port))

    def _last_words(self) -> str:
        self._words.seek(0)
        lines = [line.strip() for line in self._words.read().decode(errors="replace").splitlines() if line.strip()]
        # The last line of the output, without the position in the viewer's source.
        return re.sub(r"^.*\.rs:\d+: ", "", lines[-1]) if lines else f"exit code {self.process.returncode}"
