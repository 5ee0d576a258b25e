"""How long a STOP from the dashboard's page takes to reach the wheels, and what its pages cost the robot.

    python benchmarks/dashboard_stop.py [--stops 200] [--clients 9] [--chromium] [--quiet] [--paired N] [--half 150]

A STOP is timed from the websocket message to the first command of the gate that brakes, as this process receives it,
while another robot is shown, the map has 4000 x 4000 cells, websocket clients read everything, `--chromium` shows the
page, and the server sends a download of 100 MB again and again; `--quiet` leaves the load out. `--paired N` measures
the robots' late ticks instead, N times with the clients and without, in turns, each for `--half` s: 150 s are 3000
ticks of each robot.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
from navloom import Command, Navigator, NavloomError
from websockets.asyncio.client import connect

WORLD = """
bounds = [-10.0, -10.0, 10.0, 10.0]
start = { x = 0.0, y = 0.0 }
"""
CONFIG = """
[robot]
name = "NAME"
footprint = { radius = 0.3 }

[world]
ref = "hall.toml"

[map]
resolution = RESOLUTION

[platform]
plugin = "sensors_sim"

[[sensor]]
name = "laser"
kind = "laser_2d"

[mapper]
plugin = "known_map"

[navigation]
drive = false
start = { x = 0.0, y = 0.0 }
"""
SPEED, TURN = 0.3, 25.0
"""Speed, m/s, and turn rate, deg/s, of the circle in which the robot is driven."""
MOVING = 0.25
"""Speed from which it is stopped, m/s."""
LIMIT = 30.0
"""Longest wait for the robot, s."""
BRAKES = 0.005
"""Fall of the commanded speed that counts as braking, m/s."""


@contextmanager
def command(folder: Path, *words: str, until: str) -> Iterator[list[str]]:
    """A `navloom` command that has said something; its lines so far."""
    child = subprocess.Popen(
        [sys.executable, "-m", "navloom", *words],
        cwd=folder,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    assert child.stderr is not None
    said: list[str] = []
    for line in child.stderr:
        said.append(line)
        if until in line:
            break
    else:
        raise SystemExit(f"navloom {' '.join(words)}: {''.join(said)}")
    rest = threading.Thread(target=lambda: [None for _ in child.stderr], daemon=True)  # type: ignore[union-attr]
    rest.start()
    try:
        yield said
    finally:
        child.terminate()
        child.wait(30.0)


class Page:
    """What a page does, without a browser."""

    def __init__(self, url: str) -> None:
        self.address, self.token = url.split("/#token=")
        request = urllib.request.Request(
            f"{self.address}/api/login",
            json.dumps({"token": self.token}).encode(),
            {"Content-Type": "application/json"},
        )
        with urllib.request.urlopen(request) as answer:
            self.cookie = answer.headers["set-cookie"].split(";")[0]

    def socket(self, path: str) -> connect:
        """A websocket, as a context manager."""
        url = self.address.replace("http", "ws", 1) + path
        headers = {"Cookie": self.cookie}
        return connect(url, origin=self.address, additional_headers=headers, max_size=None, compression=None)  # type: ignore[arg-type]

    def download(self, path: str) -> None:
        """Read a file and forget it."""
        request = urllib.request.Request(self.address + path, headers={"Cookie": self.cookie})
        with urllib.request.urlopen(request) as answer:
            while answer.read(1 << 20):
                pass


def read_all(url: str, robots: list[str], clients: int) -> None:
    """Read every frame, as some clients, until this process is ended."""
    page = Page(url)

    async def one(number: int) -> None:
        async with page.socket(f"/ws/{robots[number % len(robots)]}") as socket:
            async for _ in socket:
                pass

    async def every() -> None:
        await asyncio.gather(*(one(number) for number in range(clients)))

    asyncio.run(every())


def show(url: str) -> None:
    """Show the page in Debian's Chromium, say so when it has the robot's pose, and end when stdin does."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), chromium_sandbox=os.getuid() != 0
        )
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(url)
        page.locator("#ages li").first.wait_for()
        print("shown", flush=True)
        sys.stdin.read()
        browser.close()


@contextmanager
def chromium(url: str) -> Iterator[None]:
    """The page in a browser, which a process of its own drives."""
    code = f"from dashboard_stop import show; show({url!r})"
    child = subprocess.Popen(
        [sys.executable, "-c", code], cwd=Path(__file__).parent, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert child.stdin is not None and child.stdout is not None
    try:
        if child.stdout.readline() != b"shown\n":
            raise SystemExit("Chromium does not show the page")
        yield
    finally:
        child.stdin.close()
        child.wait(30.0)


@contextmanager
def load(url: str, robots: list[str], given: argparse.Namespace, downloads: bool) -> Iterator[None]:
    """Clients in a process of their own, Chromium, and a thread that downloads."""
    with chromium(url) if given.chromium else nullcontext(), _load(url, robots, given.clients, downloads):
        yield


@contextmanager
def _load(url: str, robots: list[str], clients: int, downloads: bool) -> Iterator[None]:
    code = f"from dashboard_stop import read_all; read_all({url!r}, {robots!r}, {clients})"
    child = subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parent)
    ends = threading.Event()

    def fetch() -> None:
        page = Page(url)
        while not ends.is_set():
            page.download("/api/lab/r1/recordings/lab_r1_large.mcap")

    thread = threading.Thread(target=fetch, daemon=True)
    if downloads:
        thread.start()
    try:
        time.sleep(3.0)
        yield
    finally:
        ends.set()
        child.kill()
        child.wait()


class Wheels:
    """The gate's commands, with their time of arrival."""

    def __init__(self, robot: Navigator) -> None:
        self.speeds: list[tuple[float, float]] = []
        self._ends = False
        self._listening = robot.listen(["gate/main/command"])
        self._thread = threading.Thread(target=self._hear, daemon=True)
        self._thread.start()

    def _hear(self) -> None:
        while not self._ends:
            for told in self._listening.take(0.1):
                if isinstance(told.message, Command):
                    self.speeds.append((time.monotonic(), told.message.twist.vx))

    def close(self) -> None:
        """End the thread."""
        self._ends = True
        self._thread.join()


def driven_until_moving(wheels: Wheels, ends: threading.Event, moving: threading.Event) -> None:
    """Drive in a circle, and say when it moves, until the end."""
    while not (ends.is_set() or moving.is_set()):  # a robot that has been stopped stays so
        with suppress(NavloomError), Navigator("lab/r1") as robot:
            robot.resume()
            with robot.driving() as driver:
                while not ends.is_set():
                    driver.send(SPEED, TURN)
                    if wheels.speeds and wheels.speeds[-1][1] >= MOVING:
                        moving.set()
                    time.sleep(0.05)


async def read(socket: Any, answers: dict[int, float]) -> None:
    """Note when each STOP is answered. A connection that is not read is ended."""
    async for said in socket:
        if "n" in (answer := json.loads(said)):
            answers[answer["n"]] = time.monotonic()


class Hiccups:
    """How late this host lets a thread run that has slept for 5 ms: what every other figure contains too."""

    def __init__(self) -> None:
        self.late: list[float] = []
        threading.Thread(target=self._sleep, daemon=True).start()

    def _sleep(self) -> None:
        while True:
            due = time.monotonic() + 0.005
            time.sleep(0.005)
            self.late.append(time.monotonic() - due)


async def stops(page: Page, robot: Navigator, wheels: Wheels, count: int) -> dict[str, list[float]]:
    """Times of each STOP, s: until the first braking command, until the answer, and by how much standstill came later
    than the ramp from there."""
    table = robot.config().config.robot
    took: dict[str, list[float]] = {"braking": [], "answer": [], "later_than_ramp": []}
    answers: dict[int, float] = {}
    async with page.socket("/stop/lab/r1") as socket:
        reading = asyncio.create_task(read(socket, answers))
        for number in range(count):
            ends, moving = threading.Event(), threading.Event()
            drive = asyncio.create_task(asyncio.to_thread(driven_until_moving, wheels, ends, moving))
            limit = time.monotonic() + LIMIT
            while not moving.is_set() and time.monotonic() < limit:
                await asyncio.sleep(0.02)
            if not moving.is_set():
                ends.set()
                raise SystemExit(f"stop {number}: the robot does not drive")
            await asyncio.sleep(0.37 * (number % 7) / 7)  # at any time within a tick
            if wheels.speeds[-1][1] < MOVING:  # something else has just stopped it: STOP would show nothing
                print(f"stop {number}: it does not move any more, and is passed over", file=sys.stderr)
                ends.set()
                await drive
                continue
            began = time.monotonic()
            await socket.send(json.dumps({"n": number}))
            found = await asyncio.to_thread(braking, wheels, began)
            ends.set()
            await drive
            print(f"stop {number}", file=sys.stderr)
            if found is None:
                since = [(round(at - began, 3), round(v, 3)) for at, v in wheels.speeds if at > began - 0.5]
                raise SystemExit(f"stop {number}: the wheels did not brake within {LIMIT:g} s: {since[:100]}")
            first, speed, still = found
            took["braking"].append(first - began)
            took["later_than_ramp"].append(still - first - speed / table.max_deceleration)
            took["answer"].append(answers.get(number, math.inf) - began)
        reading.cancel()
    return took


def braking(wheels: Wheels, began: float) -> tuple[float, float, float] | None:
    """Time of the first command after `began` that brakes, the speed before it, and the time of standstill."""
    limit, first = began + LIMIT, None
    while time.monotonic() < limit:
        speeds = list(wheels.speeds[-400:])
        for (_, before), (at, now) in itertools.pairwise(speeds):
            if first is None and at > began and now < before - BRAKES:
                first = at, before
            if first is not None and at >= first[0] and now == 0.0:
                return *first, at
        time.sleep(0.005)
    return None


def late_ticks(robot: Navigator) -> tuple[int, int]:
    """Late ticks and ticks of the platform so far."""
    platform = next(node for node in robot.client.describe() if node.role == "platform")
    return platform.late_ticks or 0, platform.ticks or 0


def percentile(values: list[float], share: float) -> float:
    """A percentile, by the nearest rank."""
    return sorted(values)[min(len(values) - 1, math.ceil(share * len(values)) - 1)]


def main() -> None:
    """Measure, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=int, default=200)
    parser.add_argument("--clients", type=int, default=9)
    parser.add_argument("--paired", type=int, default=0)
    parser.add_argument("--half", type=float, default=150.0)
    parser.add_argument("--chromium", action="store_true", help="with the page in Chromium too")
    parser.add_argument("--quiet", action="store_true", help="without load")
    given = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="nl", dir="/tmp")))
        os.environ["NAVLOOM_RUNTIME_DIR"] = str(folder)
        (folder / "hall.toml").write_text(WORLD)
        names = ["r1"] if given.quiet else ["r1", "r2"]
        for name in names:
            resolution = 0.005 if name == "r1" and not given.quiet else 0.05
            text = CONFIG.replace("NAME", name).replace("RESOLUTION", str(resolution))
            (folder / f"{name}.toml").write_text(text)
            stack.enter_context(command(folder, "up", f"{name}.toml", until="every node is there"))
        (folder / "recordings").mkdir()
        (folder / "recordings" / "lab_r1_large.mcap").write_bytes(bytes(100_000_000))
        said = stack.enter_context(command(folder, "dashboard", "--port", "0", until="viewers"))
        url = next(line for line in said if "operators" in line).split()[-1]
        time.sleep(5.0)
        print("the robots are up", file=sys.stderr)
        robots = [f"lab/{name}" for name in names]
        robot = stack.enter_context(Navigator("lab/r1"))
        is_loaded = bool(given.paired) or not given.quiet
        found: dict[str, Any] = {
            "clients": given.clients if is_loaded else 0, "chromium": is_loaded and given.chromium
        }  # fmt: skip
        if given.paired:
            found |= paired([stack.enter_context(Navigator(name)) for name in robots], url, robots, given)
        else:
            wheels = Wheels(robot)
            if not given.quiet:
                stack.enter_context(load(url, robots, given, downloads=True))
            before = late_ticks(robot)
            hiccups = Hiccups()
            took = asyncio.run(stops(Page(url), robot, wheels, given.stops))
            after = late_ticks(robot)
            wheels.close()
            found |= {"stops": len(took["braking"]), "late_ticks": after[0] - before[0], "ticks": after[1] - before[1]}
            for name, values in {**took, "hiccup": list(hiccups.late)}.items():
                for share in (0.5, 0.99, 1.0):
                    found[f"{name}_p{100 * share:g}_ms"] = round(1e3 * percentile(values, share), 1)
        print(json.dumps(found))


def paired(there: list[Navigator], url: str, names: list[str], given: argparse.Namespace) -> dict[str, Any]:
    """Late ticks and ticks of each robot with the clients and without, and late ones of 1000 that the clients cost."""
    counts = {which: np.zeros((given.paired, len(there), 2), int) for which in ("with", "without")}
    for turn in range(given.paired):
        for which, found in counts.items():
            with ExitStack() as stack:
                if which == "with":
                    stack.enter_context(load(url, names, given, downloads=False))
                before = [late_ticks(robot) for robot in there]
                time.sleep(given.half)
                found[turn] = np.subtract([late_ticks(robot) for robot in there], before)
                print(f"pair {turn} {which} clients: {found[turn].tolist()}", file=sys.stderr)
    rates = {which: found[..., 0].sum() / found[..., 1].sum() for which, found in counts.items()}
    more = 1000.0 * (rates["with"] - rates["without"])
    return {**{which: found.tolist() for which, found in counts.items()}, "more_of_1000": round(float(more), 3)}


if __name__ == "__main__":
    main()
