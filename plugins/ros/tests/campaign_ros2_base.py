"""Fault campaign of `ros2_base`: drives a robot of dora-rs to five goals, then injects faults while it moves.

`python campaign_ros2_base.py PEERS [--each N] [--only FAULT …] [--out FILE]`; PEERS is a venv with the group ros-peers.
It reports for each fault the time until the base's speed was zero, by a command or by its own timeout of 0.5 s, from
the robot's own log. docs/ros2.md has the results.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

from navloom import Navigator
from navloom_ros import Types

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE / "peers")]
from describe import describe  # noqa: E402
from ros_garbler import SCANS, flipped, garble  # noqa: E402
from ros_network import free_port, until  # noqa: E402
from ros_peer import shape  # noqa: E402

TYPES = Types("kilted")
NAMES = ["nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/Twist"]
GOALS = [(3.3, 0.9), (0.0, 1.5), (5.2, -1.5), (0.5, -1.5), (0.0, 0.0)]
DEADLINE, BASE_TIMEOUT = 0.15, 0.5
CONFIG = """
[run]
stop_after = 100000.0
[robot]
name = "rosbot"
footprint = { length = 0.4, width = 0.4 }
height = 0.5
max_linear = 0.5
max_angular_deg = 90.0
max_acceleration = 1.0
[platform]
plugin = "ros2_base"
router = "ROUTER"
distribution = "kilted"
base_timeout_s = 0.5
[[sensor]]
name = "laser"
kind = "laser_scan"
[mapper]
plugin = "scan_grid"
[planner]
plugin = "astar"
cell = 0.1
[navigation]
start = { x = 0.0, y = 0.0, heading_deg = 0.0 }
speed = [0.2, 0.4]
drive = false
[live]
restart_limit = 1000
"""


class Proxy:
    """A TCP proxy that can hold all bytes back, as if packets were lost, or corrupt them."""

    def __init__(self, port: int) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.mode, self._target, self._ends = "pass", port, []
        self._door = socket.create_server(("127.0.0.1", int(self.endpoint.rpartition(":")[2])))
        threading.Thread(target=self._accept, daemon=True).start()

    def reset(self) -> None:
        """Close all connections."""
        for end in self._ends:
            end.close()
        self._ends.clear()

    def _accept(self) -> None:
        while True:
            near, _ = self._door.accept()
            try:
                far = socket.create_connection(("127.0.0.1", self._target), 1.0)
            except OSError:
                near.close()
                continue
            self._ends += [near, far]
            for one, other in ((near, far), (far, near)):
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._pump, args=(one, other), daemon=True).start()

    def _pump(self, one: socket.socket, other: socket.socket) -> None:
        try:
            one.settimeout(None)
            while data := one.recv(65536):
                while self.mode == "cut":
                    time.sleep(0.005)
                if self.mode == "garble":
                    data = bytearray(data)
                    for _ in range(1 + len(data) // 50):
                        data[random.randrange(len(data))] = random.randrange(256)
                other.sendall(data)
        except OSError:
            pass
        for end in (one, other):
            end.close()


class Rig:
    """The router, the robot and navloom, in separate processes."""

    def __init__(self, peers: Path, folder: Path) -> None:
        self.peers, self.folder = peers, folder
        self.port = free_port()
        self.ours, self.its = Proxy(self.port), Proxy(self.port)
        self.log = folder / "robot.log"
        (folder / "shapes").write_text(json.dumps({name: shape(TYPES, name) for name in NAMES}))
        (folder / "shapes.empty").write_text(json.dumps({name: TYPES.plain(TYPES.new(name)) for name in NAMES}))
        interfaces = HERE.parent / "src" / "navloom_ros" / "interfaces"
        describe(TYPES, [interfaces / "kilted", interfaces / "since_kilted"], folder / "described")
        (folder / "robot.toml").write_text(CONFIG.replace("ROUTER", self.ours.endpoint))
        os.environ["NAVLOOM_RUNTIME_DIR"] = str(folder / "run")
        self.start_router()
        self.start_robot()
        self.start_stack()

    def start_router(self) -> None:
        command = [sys.executable, str(HERE / "peers" / "zenoh_router.py"), f"tcp/127.0.0.1:{self.port}"]
        self.router = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.router.stdout.readline()

    def start_robot(self) -> None:
        python, script = str(self.peers / "bin" / "python"), str(HERE / "peers" / "dora_robot.py")
        given = [self.its.endpoint, str(self.folder / "shapes"), str(self.log), str(self.peers)]
        command = [python, "-W", "ignore", script, *given, str(self.folder / "described")]
        self.robot = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.robot.stdout.readline()

    def start_stack(self) -> None:
        with (self.folder / "up.log").open("a") as log:
            command = [str(Path(sys.executable).with_name("navloom")), "up", str(self.folder / "robot.toml")]
            self.up = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)

    def stop(self) -> None:
        self.up.send_signal(signal.SIGINT)
        for process in (self.up, self.robot, self.router):
            try:
                process.wait(10.0 if process is self.up else 0.1)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def told(self, since: float) -> list[list]:
        """Entries of the robot's log since a time, s, monotonic."""
        lines = self.log.read_text().splitlines()[-4000:]
        return [one for one in map(json.loads, lines) if one[1] >= since]

    def speed(self) -> float:
        truths = [one for one in self.told(time.monotonic() - 0.2) if one[0] == "truth"]
        return truths[-1][5] if truths else 0.0

    def pids(self, name: str) -> list[int]:
        """IDs of a navloom process by its name, or of the guardian."""
        if name == "guardian":
            return [pid for pid, line in commands() if "navloom_ros.base.guardian" in line]
        with Navigator() as robot:
            return sorted({node.pid for node in robot.client.describe() if node.process == name})

    def move(self, patience: float = 60.0) -> None:
        """Send the robot to a goal and wait until it moves. Raises TimeoutError."""
        limit, number = time.monotonic() + patience, 0
        while time.monotonic() < limit:
            try:
                with Navigator() as robot:
                    robot.resume()
                    number += 1
                    truth = [one for one in self.told(time.monotonic() - 1.0) if one[0] == "truth"][-1]
                    far = sorted(GOALS, key=lambda goal: -((goal[0] - truth[2]) ** 2 + (goal[1] - truth[3]) ** 2))
                    robot.go(*far[number % 2])
                    if until(lambda: self.speed() > 0.15, 8.0):
                        return
            except Exception as error:  # navloom is still starting
                self.last = error
                time.sleep(0.3)
        raise TimeoutError(f"the robot does not move: {self.last}")

    def begin_again(self) -> None:
        """Put the robot back to its start, and restart everything."""
        self.rescues += 1
        self.stop()
        self.ours.mode = self.its.mode = "pass"
        with self.log.open("a") as log:
            log.write(json.dumps(["truth", time.monotonic(), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]) + "\n")
        self.start_router()
        self.start_robot()
        self.start_stack()

    rescues = 0
    last: object = None


def commands():
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                yield int(entry.name), (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            except OSError:
                continue


def drive_to_goals(rig: Rig) -> list[dict]:
    rows = []
    for x, y in GOALS:
        began = time.monotonic()
        with Navigator() as robot:
            result = robot.drive_to(x, y, timeout=120.0)
        truths = [one for one in rig.told(began) if one[0] == "truth"]
        spent, error = time.monotonic() - began, ((truths[-1][2] - x) ** 2 + (truths[-1][3] - y) ** 2) ** 0.5
        least = min(truth[7] for truth in truths)
        outcome = {"goal": [x, y], "outcome": result.outcome, "reason": result.reason, "s": round(spent, 1)}
        rows.append({**outcome, "true_error_m": round(error, 3), "least_gap_m": round(least, 3)})
        print(json.dumps(rows[-1]), flush=True)
    return rows


def signalled(name: str, number: signal.Signals):
    """Signal a navloom process; a frozen one is resumed afterwards."""

    def act(rig: Rig):
        pids = [rig.up.pid] if name == "up" else rig.pids(name)
        assert pids, name
        began = time.monotonic()
        for pid in pids:
            os.kill(pid, number)

        def mend() -> None:
            for pid in pids if number == signal.SIGSTOP else ():
                with suppress(ProcessLookupError):  # a frozen guardian is replaced
                    os.kill(pid, signal.SIGCONT)
            if name == "up" and number == signal.SIGKILL:
                rig.up.wait()
                time.sleep(1.5)
                rig.start_stack()

        return began, mend

    return act


def peer(name: str, number: signal.Signals):
    def act(rig: Rig):
        process = getattr(rig, name)
        began = time.monotonic()
        process.send_signal(number)

        def mend() -> None:
            if number == signal.SIGSTOP:
                process.send_signal(signal.SIGCONT)
            else:
                process.wait()
                getattr(rig, f"start_{name}")()

        return began, mend

    return act


def linked(name: str, mode: str):
    def act(rig: Rig):
        proxy = getattr(rig, name)
        began = time.monotonic()
        proxy.mode = mode

        def mend() -> None:
            if mode == "garble":
                proxy.reset()
            proxy.mode = "pass"

        return began, mend

    return act


def garbled(topic: str, kind: str, spoil):
    """Publish spoiled copies of a topic's messages, beside the robot and faster."""

    def act(rig: Rig):
        ending = threading.Event()
        garble(f"tcp/127.0.0.1:{rig.port}", topic, kind, spoil, ending)
        return time.monotonic(), ending.set

    return act


PROCESSES = ("robot", "safe", "drive", "think")
FAULTS = {
    **{f"kill {name}": (signalled(name, signal.SIGKILL), DEADLINE) for name in PROCESSES},
    "kill up": (signalled("up", signal.SIGKILL), DEADLINE),
    **{f"stop {name}": (signalled(name, signal.SIGSTOP), DEADLINE) for name in PROCESSES},
    "kill guardian": (signalled("guardian", signal.SIGKILL), None),
    "stop guardian": (signalled("guardian", signal.SIGSTOP), None),
    "kill its router": (peer("router", signal.SIGKILL), BASE_TIMEOUT),
    "stop its router": (peer("router", signal.SIGSTOP), BASE_TIMEOUT),
    "kill the robot": (peer("robot", signal.SIGKILL), None),
    "stop the robot": (peer("robot", signal.SIGSTOP), None),
    "cut our link": (linked("ours", "cut"), BASE_TIMEOUT),
    "cut its link": (linked("its", "cut"), BASE_TIMEOUT),
    "garble our link": (linked("ours", "garble"), BASE_TIMEOUT),
    "garble its link": (linked("its", "garble"), BASE_TIMEOUT),
    "garble odometry": (garbled("/odom", "nav_msgs/msg/Odometry", flipped), None),
    "garble scans": (garbled("/scan", "sensor_msgs/msg/LaserScan", flipped), None),
    **{name: (garbled("/scan", "sensor_msgs/msg/LaserScan", spoil), None) for name, spoil in SCANS.items()},
}  # fmt: skip
"""By name, the fault, and the longest time until the base must have zero speed, s; None if it may go on driving.

Spoiled scans are left out, or are used like those with a good stamp; the robot drives by its real ones.
"""
HALF_BODY = 0.2
"""Half the side of the robot's body, m: with a smaller gap from its centre, it touches a wall."""
TICK = 0.01
"""Step of the simulated robot, s: how often it reads commands and writes its log."""


def one_case(rig: Rig, name: str) -> dict:
    act, bound = FAULTS[name]
    try:
        rig.move()
    except TimeoutError as error:
        print(f"begins again: {error}", flush=True)
        rig.begin_again()
        rig.move(120.0)
    began, mend = act(rig)
    time.sleep(1.5)
    at_rest = [one for one in rig.told(began) if one[0] in ("command", "timeout")]
    zeros = [one for one in at_rest if one[2] == one[3] == 0.0]
    first = zeros[0][1] - began if zeros else None
    again = [one for one in at_rest if zeros and one[1] > zeros[0][1] and (one[2] or one[3])]
    by = zeros[0][0] if zeros else "nothing"
    heard = [one[1] for one in rig.told(began - 2.0) if one[0] == "command" and zeros and one[1] < zeros[0][1]]
    silent = zeros[0][1] - heard[-1] if heard else None
    mend_at = time.monotonic()
    mend()
    time.sleep(1.0)
    after = [one for one in rig.told(mend_at) if one[0] == "command" and (one[2] or one[3])]
    # The base times out from the last command that it received, which may have been in transit when the link failed.
    counted = silent if bound == BASE_TIMEOUT else first
    least_gap = min(one[7] for one in rig.told(began) if one[0] == "truth")
    missed = bound is not None and (counted is None or counted > bound + TICK)
    return {
        "fault": name,
        "zero_s": first,
        "silent_s": silent,
        "by": by,
        "again": len(again),
        "after": len(after),
        "bound_s": bound,
        "least_gap_m": least_gap,
        "missed": missed,
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("peers", type=Path)
    parser.add_argument("--each", type=int, default=20)
    parser.add_argument("--only", nargs="*", default=list(FAULTS))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--keep", type=Path, help="folder for logs; by default one that is removed")
    given = parser.parse_args()
    folder = given.keep or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    rig = Rig(given.peers, folder)
    report: dict = {"goals": [], "faults": {}}
    try:
        rig.move(120.0)
        report["goals"] = drive_to_goals(rig)
        for name in given.only:
            rows = [one_case(rig, name) for _ in range(given.each)]
            report.setdefault("cases", []).extend(rows)
            times = sorted(row["zero_s"] for row in rows if row["zero_s"] is not None)
            summary = {
                "cases": len(rows), "zeros": len(times), "missed": sum(row["missed"] for row in rows),
                "median_ms": round(1e3 * times[len(times) // 2]) if times else None,
                "worst_ms": round(1e3 * times[-1]) if times else None,
                "worst_silent_ms": round(1e3 * max((row["silent_s"] or 0.0 for row in rows), default=0.0)),
                "by": {kind: sum(row["by"] == kind for row in rows) for kind in ("command", "timeout", "nothing")},
                "touched": sum(row["least_gap_m"] < HALF_BODY for row in rows),
                "rescues": rig.rescues, "bound_ms": FAULTS[name][1] and round(1e3 * FAULTS[name][1]),
            }  # fmt: skip
            report["faults"][name] = summary
            print(name, json.dumps(summary), flush=True)
            if given.out:
                given.out.write_text(json.dumps(report, indent=1))
    finally:
        rig.stop()
        if not given.keep:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
