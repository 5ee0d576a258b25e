"""A live robot that drives to and fro at full speed while faults are injected."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fault_plugins
from leftovers import Census
from motor_record import RECORD, MotorRecord
from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder
from navloom_live.live.description import Description
from navloom_live.operating.client import ClientError, Refused
from navloom_live.operating.navigator import Navigator
from pauses import Pauses

__all__ = ["FULL", "HALL", "SHARES", "Driver", "Note", "Rig", "is_running", "rig", "until"]

COMMAND = [sys.executable, "-c", "from navloom.cli import main; main()"]
START, END = 120.0, 20.0
SHARES = ("robot", "think", "drive", "safe")
"""Processes of the default split."""
FULL = 0.5
"""Highest speed of the robot, m/s."""
HALL = 150.0
"""Length that can be driven in one direction, m."""
ROOM = 12.0
"""Distance to the goal below which the robot may have to slow down during a fault, m."""
CONFIG = """
[run]
seed = 11
stop_after = 1e6

[robot]
max_linear = {full}
max_angular_deg = 60.0
max_deceleration = 1.0
wheel_radius = 0.05

[world]
ref = "hall.toml"

[map]
resolution = 0.2

[platform]
plugin = "logged_sim"
max_wheel_acceleration = 20.0     # rad/s²: the wheels brake with 1 m/s²
slip = 2e-6                       # no two commands are equal; with the default the pose drifts to a wall within 60 m

[[sensor]]
name = "sonars"
kind = "sonar_ring"

[mapper]
plugin = "faulty_map"

[planner]
plugin = "faulty_astar"

[controller]
plugin = "faulty_tracker"

[avoider]
plugin = "faulty_vfh"

[navigation]
drive = false
start = {{ x = 0.0, y = 0.0 }}
speed = [0.2, {full}]

[live]
restart_limit = 1000              # a campaign kills one process often
"""
WORLD = """
[[box]]
name = "left wall"
x = [-3.0, {end}]
y = [1.5, 1.7]

[[box]]
name = "right wall"
x = [-3.0, {end}]
y = [-1.7, -1.5]

[[box]]
name = "rear wall"
x = [-3.2, -3.0]
y = [-1.7, 1.7]

[[box]]
name = "front wall"
x = [{end}, {beyond}]
y = [-1.7, 1.7]
"""


@dataclass(frozen=True)
class Note:
    """An observation of the driver: a state of the goal, a result or an error; time of the monotonic clock, ns."""

    time_ns: int
    kind: str
    text: str


def until(claim: Callable[[], Any], timeout: float, what: str) -> Any:
    """Poll until a claim without an event, such as a line in a file, holds; returns its value."""
    limit = time.monotonic() + timeout
    while not (found := claim()):
        if time.monotonic() > limit:
            raise AssertionError(f"not within {timeout:g} s: {what}")
        time.sleep(0.005)
    return found


def is_running(pid: int) -> bool:
    """Whether a process exists and is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


class Driver(threading.Thread):
    """Keeps the robot driving: sends the next goal, at the other end of the hall, as soon as one has ended.

    Attributes:
        notes: Observations, in order of time.
        resend: Set it to send another goal at once, which pre-empts the current one.
        target: Place of the next goals along the hall, m; None for the end that is further away.
        toward: Place of the newest goal along the hall, m.
    """

    def __init__(self, motors: Callable[[], tuple[float, float]]) -> None:
        super().__init__(daemon=True)
        self.notes: list[Note] = []
        self.ending = threading.Event()
        self.resend = threading.Event()
        self.target: float | None = None
        self.toward = HALL
        self._place = motors
        self._news = threading.Condition()

    def run(self) -> None:
        """Send goals until `ending` is set."""
        while not self.ending.is_set():
            try:
                with Navigator() as navigator:
                    while not self.ending.is_set():
                        self._drive(navigator)
            except (ClientError, Refused, DirectoryError, OSError) as error:
                self._note("error", str(error))
                self.ending.wait(0.1)

    def _drive(self, navigator: Navigator) -> None:
        self.resend.clear()
        target = self.target
        if target is None:
            target = 0.0 if self._place()[0] > HALL - ROOM - 10.0 else HALL
        self.toward = target
        self._note("asked", f"{target:g}")  # the motors may turn for it before the answer arrives
        handle = navigator.go(target, 0.0)
        self._note("goal", f"{handle.goal_id} to {target:g}")
        state = ""
        while handle.result is None and not self.ending.is_set():
            with suppress(TimeoutError):
                for feedback in handle.updates(timeout=0.5):
                    if feedback.state != state:
                        state = feedback.state
                        self._note("state", state)
                    if self.ending.is_set() or self.resend.is_set():
                        return
        if handle.result is not None:
            self._note("result", f"{handle.result.outcome}: {handle.result.reason}")

    def _note(self, kind: str, text: str) -> None:
        with self._news:
            self.notes.append(Note(time.monotonic_ns(), kind, text))
            self._news.notify_all()

    def wait_for(self, claim: Callable[[Note], bool], after_ns: int, timeout: float) -> Note | None:
        """The first note after a time that fits the claim; None if there is none within the timeout, s."""

        def found() -> Note | None:
            return next((note for note in self.notes if note.time_ns > after_ns and claim(note)), None)

        with self._news:
            self._news.wait_for(found, timeout)
            return found()


class Rig:
    """A robot that is up, with the record of its motors and a driver. Use `rig`.

    Attributes:
        folder: Folder of all files, the runtime folder included.
        faults: Folder of the files that make plugins fail.
        motors: Record of the motor commands.
        driver: Thread that keeps the robot driving.
        up: Process of `navloom up`.
        census: Processes and other resources that the robot has on this host.
        pauses: Pauses of the machine.

    Args:
        folder: Folder of all files.
        more: Further tables of the config.
        environment: Further variables for all processes.
        arguments: Further arguments of `navloom up`.
    """

    def __init__(
        self, folder: Path, more: str = "", environment: Mapping[str, str] | None = None, arguments: Sequence[str] = ()
    ) -> None:
        self.folder, self.faults, self._arguments = folder, folder / "faults", arguments
        self.faults.mkdir()
        self.motors = MotorRecord(folder / "motors.bin")
        end = HALL + 3.0
        (folder / "hall.toml").write_text(WORLD.format(end=end, beyond=end + 0.2), "utf-8")
        self.config = folder / "robot.toml"
        self.config.write_text(CONFIG.format(full=FULL) + more, "utf-8")
        paths = [fault_plugins.install(folder / "plugins"), os.environ.get("PYTHONPATH", "")]
        self.environment = {
            **os.environ,
            "NAVLOOM_RUNTIME_DIR": str(folder / "rt"),
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
            RECORD: str(folder / "motors.bin"),
            fault_plugins.FOLDER: str(self.faults),
            **(environment or {}),
        }
        self.log = folder / "up.log"
        self.driver = Driver(lambda: self.motors.place)
        self.census = Census(folder)
        self.pauses = Pauses(folder)
        self._outsiders: dict[str, subprocess.Popen[str]] = {}

    def start(self) -> None:
        """Start the robot; returns when every node is there."""
        with self.log.open("ab") as log:
            self.up = subprocess.Popen(
                [*COMMAND, "up", str(self.config), *self._arguments], env=self.environment, stdout=log, stderr=log
            )  # fmt: skip
        until(lambda: self.up.poll() is not None or self.said("every node is there"), START, "the robot is up")
        assert self.up.poll() is None, self.log.read_text("utf-8")
        self.driver.start()
        self.census.start()
        self.pauses.start()

    def said(self, text: str) -> bool:
        """Whether `navloom up` has printed a text."""
        return text in self.log.read_text("utf-8")

    def run(self, *arguments: str, timeout: float = 60.0) -> subprocess.CompletedProcess[str]:
        """Run another command on the same robot."""
        return subprocess.run(
            [*COMMAND, *arguments], env=self.environment, capture_output=True, text=True, timeout=timeout, check=False
        )

    def describe(self) -> dict[tuple[str, str], Description]:
        """Description of each node that answers, by role and instance."""
        with Navigator() as navigator:
            return {(node.role, node.instance): node for node in navigator.client.describe()}

    def outsider(self, what: str) -> subprocess.Popen[str]:
        """A process that joins the robot's network, started once; it reads and prints lines."""
        process = self._outsiders.get(what)
        if process is None or process.poll() is not None:
            command = [sys.executable, str(Path(__file__).with_name("outsider.py")), what]
            process = subprocess.Popen(
                command, env=self.environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            self._outsiders[what] = process
            self.hear(process)
        return process

    def outsiders(self) -> list[int]:
        """Process IDs of the outsiders."""
        return [process.pid for process in self._outsiders.values()]

    @staticmethod
    def hear(process: subprocess.Popen[str]) -> dict[str, Any]:
        """The next line that an outsider prints, as JSON."""
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line, "the outsider has ended"
        found: dict[str, Any] = json.loads(line)
        return found

    def pids(self) -> dict[str, int]:
        """Running processes of the robot, by name; one that is being restarted is left out."""
        fates = RobotFolder("lab", "r1").fates()
        return {name: fate.pid for name, fate in fates.items() if fate.pid is not None and is_running(fate.pid)}

    def tell(self, instance: str, way: str) -> Path:
        """Make an instance fail until the returned file is deleted."""
        path = self.faults / f"{instance}.{way}"
        path.touch()
        return path

    def wait_full_speed(self, timeout: float = 60.0) -> None:
        """Wait until the robot drives at full speed with room ahead."""
        try:
            until(self.is_at_full_speed, timeout, "the robot drives at full speed with room ahead")
        except AssertionError as error:
            x, toward, notes = self.motors.place[0], self.driver.toward, self.driver.notes[-3:]
            raise AssertionError(f"{error}; it is at {x:.1f} m on its way to {toward:g} m; last: {notes}") from None

    def is_at_full_speed(self) -> bool:
        """Whether it has driven at full speed for half a second with room ahead; without room it is sent back."""
        speed, ticks = self.motors.speed(10), self.motors.ticks[-5:]
        if not ticks:
            return False
        ahead = self.driver.toward - ticks[-1].x
        if abs(ahead) < ROOM:
            self.driver.resend.set()
            return False
        return speed > 0.97 * FULL and (ticks[-1].x - ticks[0].x) * ahead > 0.0

    def reach_a_goal(self, timeout: float = 60.0) -> str:
        """Drive to a place 3 m ahead; returns the result."""
        now = time.monotonic_ns()
        self.driver.target = self.motors.place[0] + 3.0
        self.driver.resend.set()
        sent = self.driver.wait_for(lambda note: note.kind == "goal", now, timeout)
        assert sent is not None, self.driver.notes[-5:]
        ended = self.driver.wait_for(lambda note: note.kind == "result", sent.time_ns, timeout)
        self.driver.target = None
        return "no result" if ended is None else ended.text

    def end(self) -> float:
        """Send SIGTERM to `up`; returns the time until it and all its processes have ended, s."""
        self.driver.ending.set()
        self._end_outsiders()
        pids = self.pids().values()
        if self.up.poll() is None:
            began = time.monotonic()
            self.up.send_signal(signal.SIGTERM)
            self.up.wait(END)
        else:
            began = time.monotonic()
        until(lambda: not any(map(is_running, pids)), END, "every process has ended")
        took = time.monotonic() - began
        self.driver.join(10.0)
        return took

    def _end_outsiders(self) -> None:
        while self._outsiders:
            _, outsider = self._outsiders.popitem()
            outsider.kill()
            outsider.communicate()

    def clear(self) -> None:
        """End every process, in whatever state."""
        self.driver.ending.set()
        self.census.ending.set()
        self.pauses.end()
        self._end_outsiders()
        pids = [*self.pids().values()]
        if hasattr(self, "up") and self.up.poll() is None:
            for pid in (*pids, self.up.pid):
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)
            self.up.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                self.up.wait(END)
        for pid in pids:
            with suppress(ProcessLookupError):
                if is_running(pid):
                    os.kill(pid, signal.SIGKILL)
        if hasattr(self, "up") and self.up.poll() is None:
            self.up.kill()
            self.up.wait()
        if self.driver.ident is not None:
            self.driver.join(10.0)


@contextmanager
def rig(more: str = "", make: Callable[[Path, str], Rig] = Rig) -> Iterator[Rig]:
    """A robot that is up and drives; always ended on exit.

    Args:
        more: Further tables of its config.
        make: Makes the rig from a folder and these tables.
    """
    folder = Path(tempfile.mkdtemp(prefix="nf", dir="/tmp"))  # short: the path of a socket is limited
    before = os.environ.get("NAVLOOM_RUNTIME_DIR")
    os.environ["NAVLOOM_RUNTIME_DIR"] = str(folder / "rt")  # for the driver, which joins from this process
    try:
        made = make(folder, more)
        try:
            made.start()
            yield made
        finally:
            made.clear()
    finally:
        if before is None:
            del os.environ["NAVLOOM_RUNTIME_DIR"]
        else:
            os.environ["NAVLOOM_RUNTIME_DIR"] = before
        shutil.rmtree(folder, ignore_errors=True)
