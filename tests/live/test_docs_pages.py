"""The steps of README and docs, run from top to bottom: each page in its own folder, with its own live robots."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import math
import os
import pty
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from doc_pages import NOT_RUN, PAGES, STAND_INS, TOP, Step, listed, needs_a_shell, steps, words
from live_rig import COMMAND, runtime_folder
from navloom.cli import main
from navloom.plugins import Registry

pytestmark = pytest.mark.once
START, END = 120.0, 30.0
"""Longest time for a command to start its work, and to end once asked to, s."""
STAYING = {
    "up": "every node is there", "goal": "driving|succeeded", "record": "recording", "echo": "", "teleop": "x ends",
    "replay": "publish",
}  # fmt: skip
"""Commands that need their own terminal -> pattern of the line that they print once they work.

A goal may succeed at once, where the robot was stopped before it left."""
VARYING = 0.15
"""Largest share of the words that a page shows and a command may leave out, because the robot is in another state."""


class Terminal:
    """A command that runs until it is ended: by a key if it reads keys, else by Ctrl-C."""

    def __init__(
        self, step: Step, arguments: list[str], folder: Path | None = None, runtime: Path | None = None
    ) -> None:
        self.step, self.command = step, arguments[0]
        self.keyboard, keys = pty.openpty()
        self.process = subprocess.Popen(
            [*COMMAND, *arguments],
            stdin=keys,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
            env=None if runtime is None else {**os.environ, "NAVLOOM_RUNTIME_DIR": str(runtime)},
        )
        os.close(keys)
        self.said: list[str] = []
        self._news = threading.Condition()
        self._over = False
        threading.Thread(target=self._read, daemon=True).start()

    def wait(self) -> None:
        """Wait until the command works, by its pattern in STAYING."""
        awaited = re.compile(STAYING[self.command])
        with self._news:
            self._news.wait_for(lambda: self._over or any(map(awaited.search, self.said)), START)
        assert any(map(awaited.search, self.said)), f"{self.step}: {awaited.pattern!r} was not said: {self.said}"

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._news:
                self.said.append(line.rstrip())
                self._news.notify_all()
        with self._news:
            self._over = True
            self._news.notify_all()

    def end(self) -> None:
        """End the command as a user does; an interrupted goal or drive is no failure of the page."""
        try:
            if self.command == "teleop":
                self._press_x()
            elif self.process.poll() is None:
                self.process.send_signal(signal.SIGINT)
            code = self.process.wait(END)
        finally:
            if self.process.poll() is None:
                self.process.kill()
                self.process.wait()
            os.close(self.keyboard)
        allowed = {"up": {0, 1}, "goal": {0, 1, 130}}.get(self.command, {0})
        assert code in allowed, (str(self.step), code, self.said[-20:])

    def _press_x(self) -> None:
        """Press x until the command ends: keys pressed before the terminal is set up are lost."""
        limit = time.monotonic() + END
        while self.process.poll() is None and time.monotonic() < limit:
            os.write(self.keyboard, b"x")
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(0.2)


class Reader:
    """Runs the steps of a page in its own folder."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.capsys, self.monkeypatch = folder, capsys, monkeypatch
        self.terminals: list[Terminal] = []
        self.pids: dict[str, int] = {}

    def take(self, step: Step, is_slow: bool = False) -> None:
        """Run one step of a page."""
        if step.kind == "file":
            with (self.folder / step.name).open("a", encoding="utf-8") as file:
                file.write("\n" + step.text)
        elif step.kind == "python":
            self._run_code(step)
        elif step.kind == "scene":
            self._set(step)
        elif step.kind in ("command", "inline") and listed(NOT_RUN, step) is None:
            entry = None if is_slow else listed(STAND_INS, step)
            self._type(step, step.text if entry is None else STAND_INS[entry])

    def close(self, command: str = "") -> None:
        """End the terminals of one command, or all terminals, newest first."""
        for terminal in [one for one in reversed(self.terminals) if command in ("", one.command)]:
            self.terminals.remove(terminal)
            terminal.end()

    def _type(self, step: Step, text: str) -> None:
        if needs_a_shell(text):
            self._ask_shell(step)
            return
        arguments = words(text)
        command = arguments[0]
        stays = command in STAYING and not {"--count", "--barrier", "--help", "--vx"} & {*arguments}
        if not stays or (command == "replay" and "--live" not in arguments):
            self.run(step, arguments)
            return
        self.close(command)
        terminal = Terminal(step, arguments)
        self.terminals.append(terminal)
        terminal.wait()
        if command in ("record", "echo", "teleop"):
            self.close(command)

    def run(self, step: Step, arguments: list[str] | None = None) -> None:
        """Run a command that ends by itself; in this process, because a new interpreter costs a second."""
        arguments = arguments or words(step.text)
        self.capsys.readouterr()
        self.monkeypatch.setattr(sys, "argv", ["navloom", *arguments])
        with pytest.raises(SystemExit) as caught, patch.dict(os.environ):
            main()
        said, complained = self.capsys.readouterr()
        assert (caught.value.code or 0) in codes(step, arguments[0]), (str(step), caught.value.code, said + complained)
        if step.output:
            assert missing(step.output, said) == [], (str(step), said)

    def _run_code(self, step: Step) -> None:
        scope: dict[str, object] = {"__name__": "page"}
        exec(compile(step.text, str(step.page), "exec", dont_inherit=True), scope)
        register = scope.get("navloom_register")
        if callable(register):
            register(Registry())

    def _ask_shell(self, step: Step) -> None:
        """Run a command with a redirection or another program in a shell whose home is the page's folder."""
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        environment = {**os.environ, "HOME": str(self.folder), "PATH": path}
        done = subprocess.run(["bash", "-c", step.text], env=environment, capture_output=True, text=True, timeout=START)
        assert done.returncode == 0, (str(step), done.stdout + done.stderr)

    def _set(self, step: Step) -> None:
        if step.text in SCENES:
            SCENES[step.text](self)
        else:
            self._type(step, step.text)

    def send(self, number: signal.Signals, process: str) -> None:
        """Send a signal to a process of the robot; after SIGKILL, wait until it has restarted."""
        from navloom_live.operating.navigator import Navigator

        with Navigator() as navigator:
            if process not in self.pids:
                self.pids.update({node.process: node.pid for node in navigator.client.describe()})
            os.kill(self.pids[process], number)
            limit = time.monotonic() + START
            while number == signal.SIGKILL and not _pids(navigator, process) - {self.pids[process]}:
                assert time.monotonic() < limit, f"{process} did not start again"


def it_stands(reader: Reader) -> None:
    """Wait until an ordinary stop has ended its ramp."""
    from navloom_live.operating.introspection import last
    from navloom_live.operating.navigator import Navigator

    with Navigator() as navigator:
        limit = time.monotonic() + START
        while not getattr(status := last(navigator.client, "gate", "main", "status"), "stopped", False):
            assert time.monotonic() < limit, f"the gate does not stop: {status}"


def _pids(navigator: Any, process: str) -> set[int]:
    """Numbers of the processes in which the nodes of a process answer."""
    return {node.pid for node in navigator.client.describe() if node.process == process}


def codes(step: Step, command: str) -> set[int]:
    """Exit codes that the page leads its reader to expect: 1 where it shows a problem."""
    if command == "doctor" and not step.output:
        return {0, 1}
    return {1} if any(line.startswith("problem: ") for line in step.output) else {0}


def missing(shown: tuple[str, ...], said: str) -> list[str]:
    """Words that a page shows and the command did not print.

    Names and numbers differ from run to run, so only words in lower case that are no path and no number count. The
    first word of each line and all of a table's header must be there, and of the other words most.
    """
    is_table = re.search(r"\S {2,}\S.* {2,}\S", shown[0]) is not None
    lines = [bare_words(line) for line in shown]
    fixed = [word for line in lines for word in (line if is_table and line is lines[0] else line[:1])]
    every = [word for line in lines for word in line if IN_LOWER_CASE.fullmatch(word)]
    spoken = {*bare_words(said)}
    lost = [word for word in every if word not in spoken]
    return [word for word in lost if word in fixed] or (lost if len(lost) > VARYING * len(every) else [])


IN_LOWER_CASE = re.compile(r"[a-z][a-z_-]+")


def bare_words(text: str) -> list[str]:
    """Words without the punctuation around them."""
    return [word.strip(",:;()") for word in text.split()]


def a_sweep(reader: Reader) -> None:
    """A recorded sweep: a floor 0.6 m below the sensor, and a wall 4 m ahead."""
    pitch, beam = np.radians(np.arange(-40.0, 11.0))[:, None], np.radians(np.arange(-60.0, 61.0))[None, :]
    below = np.maximum(np.sin(-pitch), 0.01)
    ranges = np.minimum(0.6 / (below * np.cos(beam)), 4.0 / (np.cos(pitch) * np.cos(beam)))
    degrees = {"pitch_deg": np.degrees(pitch).ravel(), "beam_deg": np.degrees(beam).ravel()}
    np.savez(reader.folder / "sweep.npz", ranges_m=ranges, **degrees)


def a_bag(reader: Reader) -> None:
    """A ROS 1 bag of a robot that drives through a room."""
    path = TOP / "plugins" / "ros" / "tests" / "ros_bags.py"
    spec = importlib.util.spec_from_file_location("navloom_docs_bags", path)
    assert spec is not None and spec.loader is not None
    bags = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = bags
    spec.loader.exec_module(bags)
    bags.room_bag(reader.folder / "drive.bag", 1)


def a_carmen_log(reader: Reader) -> None:
    """A CARMEN log of a robot that drives along a wall 2 m to its left."""
    ranges = " ".join(f"{min(2.0 / max(math.sin(math.radians(beam)), 0.03), 60.0):.3f}" for beam in range(-90, 90))
    lines = []
    for number in range(20):
        pose, time = f"{0.1 * number} 0 0", f"{0.1 * number} host {0.1 * number}"
        lines += [f"ODOM {pose} 1 0 0 {time}", f"FLASER 180 {ranges} {pose} {pose} {time}"]
    (reader.folder / "drive.log").write_text("\n".join(lines) + "\n")


def the_tours_robot(reader: Reader) -> None:
    for step in steps(TOP / "docs" / "tour.md"):
        if step.kind == "file" and step.name == "robot.toml":
            reader.take(step)


def the_tutorials_avoider(reader: Reader) -> None:
    """The clear_way.py of the tutorial, in its own folder."""
    folder = reader.folder / "navloom-clear-way"
    folder.mkdir()
    for step in steps(TOP / "docs" / "tutorial.md"):
        if step.kind == "file" and step.name == "clear_way.py":
            reader.take(dataclasses.replace(step, name="navloom-clear-way/navloom_clear_way.py"))


SCENES: dict[str, Callable[[Reader], None]] = {
    "a sweep": a_sweep,
    "a bag": a_bag,
    "a CARMEN log": a_carmen_log,
    "the tutorial's avoider": the_tutorials_avoider,
    "robot.toml of the tour": the_tours_robot,
    "think is stopped": lambda reader: reader.send(signal.SIGSTOP, "think"),
    "think goes on": lambda reader: reader.send(signal.SIGCONT, "think"),
    "drive is killed": lambda reader: reader.send(signal.SIGKILL, "drive"),
    "it stands": it_stands,
    "that terminal is closed": lambda reader: reader.close(),
}
"""Scenes that a page assumes, by the words of its comment `before: …`; other words are a command."""


@pytest.fixture
def reader(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[Reader]:
    with runtime_folder() as folder:
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(folder))
        monkeypatch.chdir(tmp_path)
        monkeypatch.syspath_prepend(tmp_path)  # Python blocks import the files of their page
        (tmp_path / "examples").symlink_to(TOP / "examples")  # pages name them as in a checkout
        one = Reader(tmp_path, capsys, monkeypatch)
        try:
            yield one
        finally:
            one.close()


def has_something(page: Path, slow: bool) -> bool:
    """Whether a page has a step to run; for the slow test, one that the fast test replaces by a stand-in."""
    taken = [step for step in steps(page) if step.kind in ("command", "inline", "python") and not listed(NOT_RUN, step)]
    return any(listed(STAND_INS, step) for step in taken) if slow else bool(taken)


@pytest.mark.parametrize("page", [page for page in PAGES if has_something(page, False)], ids=lambda page: page.name)
def test_every_step_of_a_page_works_from_top_to_bottom(page: Path, reader: Reader) -> None:
    for step in steps(page):
        reader.take(step)


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if has_something(page, True)], ids=lambda page: page.name)
def test_the_long_commands_of_a_page_work(page: Path, reader: Reader) -> None:
    for step in steps(page):
        if step.kind == "file" or listed(STAND_INS, step):
            reader.take(step, is_slow=True)


@pytest.mark.slow
def test_the_two_hosts_of_the_security_page(reader: Reader, free_address: str) -> None:
    """Both hosts run on the loopback, each in its own folders; only the address differs from the page."""
    page = [replaced(step, free_address) for step in steps(TOP / "docs" / "security.md")]
    commands = [step for step in page if step.kind == "command"]
    new_keys, copy, up_base, up_brain, goal = commands
    for step in (one for one in page if one.kind in ("scene", "file")):
        reader.take(step)
    reader.run(new_keys)
    brain = reader.folder / "robot"
    (brain / "keys").mkdir(mode=0o700, parents=True)
    for pattern in (word for word in copy.text.split() if "." in word or "*" in word):
        for file in reader.folder.glob(pattern):
            shutil.copy(file, brain / file.relative_to(reader.folder))
    with runtime_folder() as runtime:
        ups = [
            Terminal(up_base, words(up_base.text)),
            Terminal(up_brain, words(up_brain.text.partition("&& ")[2]), brain, runtime),
        ]
        reader.terminals += ups
        for terminal in ups:
            terminal.wait()
        reader.take(Step(goal.page, goal.line, "scene", goal.text))
        reader.run(next(step for step in page if step.text.startswith("navloom stop --connect")))
        reader.close()


def replaced(step: Step, address: str) -> Step:
    """A step with a loopback address in place of that of the page's first host."""
    host = address.partition(":")[0]
    return dataclasses.replace(step, text=step.text.replace("10.0.0.1:7447", address).replace("10.0.0.1", host))


@pytest.fixture
def free_address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"
