"""Several hosts on one machine: network namespaces on their own switch, with cables that can be cut or slow.

Every name contains the number of this process and of the rig within it, addresses exist only in the namespaces, and
nothing is created in the machine's own network, so any number of rigs can run side by side.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from motor_log import install

__all__ = ["Host", "Lab", "Program", "Slow", "lab", "last_words", "until", "why_not"]

COMMAND = [sys.executable, "-c", "from navloom.cli import main; main()"]
START, END = 120.0, 20.0
SWITCH = "switch"
_numbers = itertools.count()


@dataclass(frozen=True)
class Slow:
    """A cable's rate in bit/s, its delay one way in s, and the share of frames it loses; the same both ways."""

    rate: float = 20e6
    delay: float = 0.05
    loss: float = 0.01


class Program:
    """A process on a host, with the lines that it prints."""

    def __init__(self, command: Sequence[str], environment: dict[str, str]) -> None:
        self.process = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.said: list[str] = []
        self._news = threading.Condition()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._news:
                self.said.append(line.rstrip())
                self._news.notify_all()
        with self._news:
            self.said.append("(ended)")
            self._news.notify_all()

    def wait_for(self, text: str, timeout: float = START, after: int = 0) -> int:
        """Wait until a line with this text is printed; returns the number of lines up to it."""

        def found() -> int:
            return next((n + 1 for n, line in enumerate(self.said) if n >= after and text in line), 0)

        with self._news:
            self._news.wait_for(lambda: found() or self.said[-1:] == ["(ended)"], timeout)
            if not found():
                raise AssertionError(f"{text!r} was not said within {timeout:g} s: {self.said}")
            return found()

    def end(self, number: signal.Signals = signal.SIGINT) -> int:
        """Send Ctrl-C, or another signal; returns the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(END)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise


@dataclass
class Host:
    """One host.

    Attributes:
        name: Name in the config's `[live.hosts]`.
        namespace: Network namespace.
        address: Address in the switch's network.
        runtime: Runtime folder.
        uptime: How far its monotonic clock is ahead of this machine's, s.
        environment: Variables of its processes in addition to this one's.
    """

    name: str
    namespace: str
    address: str
    runtime: Path
    uptime: int
    environment: dict[str, str]
    programs: list[Program] = field(default_factory=list)

    def command(self, *arguments: str) -> list[str]:
        """Command line that runs a navloom command on this host."""
        return [*self._inside(), *COMMAND, *arguments]

    def _inside(self) -> list[str]:
        inside = ["ip", "netns", "exec", self.namespace]
        if self.uptime:
            inside += ["unshare", "--time", "--monotonic", str(self.uptime), "--boottime", str(self.uptime)]
        return inside

    def surroundings(self) -> dict[str, str]:
        """Environment of its processes."""
        return {**os.environ, "NAVLOOM_RUNTIME_DIR": str(self.runtime), **self.environment}

    def start(self, *arguments: str) -> Program:
        """Start a navloom command that keeps running."""
        self.programs.append(Program(self.command(*arguments), self.surroundings()))
        return self.programs[-1]

    def python(self, script: str, *arguments: str) -> Program:
        """Start a script of this folder that keeps running."""
        command = [*self._inside(), sys.executable, str(Path(__file__).with_name(script)), *arguments]
        self.programs.append(Program(command, self.surroundings()))
        return self.programs[-1]

    def run(self, *arguments: str, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
        """Run a navloom command to its end."""
        return subprocess.run(
            self.command(*arguments), env=self.surroundings(), capture_output=True, text=True, timeout=timeout,
            check=False,
        )  # fmt: skip

    def json(self, *arguments: str, timeout: float = 120.0) -> Any:
        """Value that a navloom command prints with --json."""
        done = self.run(*arguments, "--json", timeout=timeout)
        assert done.stdout, done.stderr
        return json.loads(done.stdout)


class Lab:
    """Hosts on a switch. Use `lab`.

    Args:
        folder: Folder for runtime folders and logs.
        names: Names of the hosts.
        slow: Slow cables, by host.
        own_clocks: Each host after the first has its own monotonic clock, as real hosts do.
    """

    def __init__(self, folder: Path, names: Sequence[str], slow: dict[str, Slow], own_clocks: bool) -> None:
        self.folder, self.slow = folder, slow
        self.prefix = f"nl{os.getpid()}-{next(_numbers)}"
        plugins = install(folder / "plugins")
        self.hosts = {
            name: Host(
                name, f"{self.prefix}-{name}", f"10.77.0.{number}", folder / name, 40_000 * (number - 1) * own_clocks,
                {"PYTHONPATH": os.pathsep.join(filter(None, (plugins, os.environ.get("PYTHONPATH"))))},
            )
            for number, name in enumerate(names, 1)
        }  # fmt: skip
        self._wires: list[subprocess.Popen[str]] = []

    def __getitem__(self, name: str) -> Host:
        return self.hosts[name]

    def build(self) -> None:
        """Create namespaces, switch and cables."""
        switch = f"{self.prefix}-{SWITCH}"
        _ip("netns", "add", switch)
        _ip("-n", switch, "link", "add", "name", "br0", "type", "bridge", "forward_delay", "0", "stp_state", "0")
        _ip("-n", switch, "link", "set", "dev", "br0", "up")
        for name, host in self.hosts.items():
            host.runtime.mkdir()
            _ip("netns", "add", host.namespace)
            _ip("-n", host.namespace, "link", "set", "dev", "lo", "up")
            self._cable(switch, name, host)
            _ip("-n", host.namespace, "address", "add", f"{host.address}/24", "dev", "eth0")
            _ip("-n", host.namespace, "link", "set", "dev", "eth0", "up")
            _ip("-n", switch, "link", "set", "dev", name, "master", "br0", "up")

    def _cable(self, switch: str, name: str, host: Host) -> None:
        if name not in self.slow:
            _ip("-n", switch, "link", "add", "name", name, "type", "veth", "peer", "name", "eth0",
                "netns", host.namespace)  # fmt: skip
            return
        for namespace, device in ((switch, name), (host.namespace, "eth0")):
            _ip("-n", namespace, "tuntap", "add", "dev", device, "mode", "tap")
        cable = self.slow[name]
        wire = subprocess.Popen(
            ["nice", "-n", "-15", sys.executable, str(Path(__file__).with_name("slow_wire.py")), f"{switch}/{name}",
             f"{host.namespace}/eth0", str(cable.rate), str(cable.delay), str(cable.loss)],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._wires.append(wire)
        assert wire.stdout is not None and wire.stdout.readline() == "ready\n"

    def cut(self, name: str) -> None:
        """Pull a host's cable out of the switch."""
        _ip("-n", f"{self.prefix}-{SWITCH}", "link", "set", "dev", name, "down")

    def mend(self, name: str) -> None:
        """Put a host's cable back."""
        _ip("-n", f"{self.prefix}-{SWITCH}", "link", "set", "dev", name, "up")

    def clear(self) -> None:
        """End every process and remove every namespace, whatever state they are in."""
        programs = [program for host in self.hosts.values() for program in host.programs]
        for program in programs:
            if program.process.poll() is None:
                program.process.send_signal(signal.SIGINT)
        for program in programs:
            with contextlib.suppress(subprocess.TimeoutExpired):
                program.end()
        for wire in self._wires:
            wire.kill()
            wire.wait()
        for namespace in [*(host.namespace for host in self.hosts.values()), f"{self.prefix}-{SWITCH}"]:
            subprocess.run(["ip", "netns", "del", namespace], capture_output=True, check=False)


@contextmanager
def lab(*names: str, slow: dict[str, Slow] | None = None, own_clocks: bool = True) -> Iterator[Lab]:
    """Hosts of these names; always removed on exit."""
    folder = Path(tempfile.mkdtemp(prefix="nl", dir="/tmp"))  # short: the path of a socket is limited
    made = Lab(folder, names, slow or {}, own_clocks and _has_time_namespaces())
    try:
        made.build()
        yield made
    finally:
        made.clear()
        shutil.rmtree(folder, ignore_errors=True)


def why_not() -> str:
    """Why hosts cannot be created here; empty if they can."""
    if shutil.which("ip") is None:
        return "`ip` of iproute2 is not installed"
    if not Path("/dev/net/tun").exists():
        return "/dev/net/tun is missing, which slow cables need"
    probe = f"nl{os.getpid()}-probe"
    try:
        _ip("netns", "add", probe)
        _ip("-n", probe, "tuntap", "add", "dev", "tap0", "mode", "tap")
        _ip("-n", probe, "link", "add", "name", "p0", "type", "veth", "peer", "name", "p1")
        _ip("netns", "exec", probe, "true")
    except AssertionError as error:
        return f"no network namespaces may be made here (CAP_NET_ADMIN, CAP_SYS_ADMIN): {error}"
    finally:
        subprocess.run(["ip", "netns", "del", probe], capture_output=True, check=False)
    return ""


@contextmanager
def last_words(*programs: Program, ask: Callable[[], str]) -> Iterator[None]:
    """Add the last lines of programs, and the answer of `ask`, to the message of an AssertionError."""
    try:
        yield
    except AssertionError as error:
        raise AssertionError(f"{error}: {[program.said[-30:] for program in programs]} {ask()}") from error


def until(claim: Callable[[], Any], timeout: float, what: str) -> Any:
    """Poll until a claim without an event, such as a line in a file, holds; returns its value."""
    limit = time.monotonic() + timeout
    while not (found := claim()):
        if time.monotonic() > limit:
            raise AssertionError(f"not within {timeout:g} s: {what}")
        time.sleep(0.005)
    return found


def _has_time_namespaces() -> bool:
    done = subprocess.run(["unshare", "--time", "--monotonic", "1", "true"], capture_output=True, check=False)
    return done.returncode == 0


def _ip(*arguments: str) -> None:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"ip {' '.join(arguments)}: {done.stderr.strip()}"
