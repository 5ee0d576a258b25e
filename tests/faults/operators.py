"""Two operators send goals and cancel them at random: `python tests/faults/operators.py --help`.

Every request must end in an answer or a typed error within a bound, and be carried out once at most. Optionally the
process with the goal node is killed every few seconds. It prints a line of JSON for each session.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "live"))

from live_rig import EMPTY, Up, up
from navloom_live.live.requests import CANCEL, SUBMIT, Submit
from navloom_live.live.service import Nothing
from navloom_live.operating.client import Client, ClientError, Refused
from navloom_live.operating.robot_lookup import join

__all__ = ["CONFIG", "main", "session"]

CONFIG = (
    EMPTY
    + """
[live]
restart_limit = 1000
"""
)
BOUND = 10.0
"""Time after which a request counts as hanging, s: more than any client waits."""
GOALS = 230 / 310
"""Share of requests that send a goal; the others cancel."""
AGAIN = 60.0
"""Longest time for a killed process to be up again, s."""
PAUSE = 0.2
"""Longest pause between two requests of an operator, s."""
KILL_EVERY = 6.0
"""Time between two kills of the process with the goal node, s."""
JOINED = 10
"""Requests of an operator before it joins the robot's network again, as each command of the CLI does."""


def operator(seed: int, requests: int) -> dict[str, Any]:
    """Send random requests; returns how they ended, the longest time, and the numbers of the goals."""
    source = random.Random(seed)
    ended: Counter[str] = Counter()
    goals: list[int] = []
    longest = 0.0
    for first in range(0, requests, JOINED):
        with join() as client:
            _count_attempts(client, ended)
            for _ in range(min(JOINED, requests - first)):
                what = "submit" if source.random() < GOALS else "cancel"
                place = source.uniform(-2.0, 2.0), source.uniform(-2.0, 2.0)
                goal = Submit(*place) if what == "submit" else None
                began, found = time.monotonic(), []
                thread = threading.Thread(target=lambda: found.append(_ask(client, goal)), daemon=True)  # noqa: B023
                thread.start()
                thread.join(BOUND)
                longest = max(longest, time.monotonic() - began)
                how, number = found[0] if found else ("hangs", 0)
                ended[f"{what} {how}"] += 1
                if what == "submit" and number:
                    goals.append(number)
                time.sleep(source.uniform(0.0, PAUSE))
    return {"ended": dict(sorted(ended.items())), "longest_s": round(longest, 2), "goals": goals}


def _ask(client: Client, goal: Submit | None) -> tuple[str, int]:
    """Send a goal, or cancel the current one."""
    try:
        if goal is None:
            return "answered", client.call("goal", "main", CANCEL, Nothing()).goal_id
        return "answered", client.call("goal", "main", SUBMIT, goal).goal_id
    except Refused:
        return "refused", 0
    except ClientError as error:
        return type(error).__name__, 0


def _count_attempts(client: Client, ended: Counter[str]) -> None:
    """Count queries that time out or get no reply, whether or not the client repeats them."""
    ask = client.bus.ask

    def counted(*args: Any, **kwargs: Any) -> Iterator[Any]:
        answers = 0
        for answer in ask(*args, **kwargs):
            answers += 1
            if answer.refusal == "Timeout":
                ended["(questions that timed out)"] += 1
            yield answer
        if not answers:
            ended["(questions without any reply)"] += 1

    client.bus.ask = counted  # type: ignore[method-assign]


def session(requests: int, seed: int, kills: bool, settings: list[str], folder: Path) -> dict[str, Any]:
    """Two operators at one robot; returns how all requests ended, and how many goals the robot received."""
    config = folder / "robot.toml"
    config.write_text(CONFIG, "utf-8")
    with up(str(config), *settings) as robot:
        robot.wait_for("every node is there")
        ends = threading.Event()
        killer = threading.Thread(target=_end_now_and_then, args=(robot, ends))
        if kills:
            killer.start()
        command = [sys.executable, __file__, "--operator"]
        operators = [
            subprocess.Popen(
                [*command, "--seed", str(seed + n), "--requests", str(requests // 2)],
                env=robot.environment, stdout=subprocess.PIPE, text=True,
            )
            for n in range(2)
        ]  # fmt: skip
        said = [json.loads(one.communicate()[0]) for one in operators]
        ends.set()
        if kills:
            killer.join()
        found = _summed(said)
        print(json.dumps(found), file=sys.stderr, flush=True)
        return {**found, "goals_of_the_robot": _last_goal(robot)}


def _summed(said: list[dict[str, Any]]) -> dict[str, Any]:
    ended: Counter[str] = Counter()
    for one in said:
        ended.update(one["ended"])
    goals = [number for one in said for number in one["goals"]]
    return {
        "ended": dict(sorted(ended.items())),
        "longest_s": max(one["longest_s"] for one in said),
        "goals_answered": len(goals),
        "goals_answered_twice": len(goals) - len(set(goals)),
    }


def _last_goal(robot: Up) -> int:
    """Number of goals that the robot has received: that of one more goal, less one."""
    os.environ["NAVLOOM_RUNTIME_DIR"] = robot.environment["NAVLOOM_RUNTIME_DIR"]
    limit = time.monotonic() + AGAIN
    while True:
        try:
            with join() as client:
                return client.call("goal", "main", SUBMIT, Submit(0.5, 0.5)).goal_id - 1
        except (ClientError, Refused) as error:
            assert time.monotonic() < limit, f"the goal's node is not there again: {error}"


def _end_now_and_then(robot: Up, ends: threading.Event) -> None:
    signals = itertools.cycle((signal.SIGTERM, signal.SIGKILL))
    while not ends.wait(KILL_EVERY):
        for node in robot.json("list"):
            if node["role"] == "goal" and node["pid"]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(node["pid"], next(signals))


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sessions", type=int, default=1)
    parser.add_argument("--requests", type=int, default=310, help="of both operators together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kills", action="store_true", help="the process with the goal's node ends every 6 s")
    parser.add_argument("--set", action="append", default=[], help="as for `navloom up`")
    parser.add_argument("--operator", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.operator:
        print(json.dumps(operator(given.seed, given.requests)), flush=True)
        return
    for number in range(given.sessions):
        settings = [word for one in given.set for word in ("--set", one)]
        with tempfile.TemporaryDirectory() as folder:
            found = session(given.requests, given.seed + 2 * number, given.kills, settings, Path(folder))
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
