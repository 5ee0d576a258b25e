"""Time from a sensor's stamp to the command at the platform, of the paper's robot in live processes.

`python benchmarks/stamp_to_command.py [--json] [--period S] [--seconds S]`. README.md beside this file explains the
figures.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.streams import STEP
from navloom.engine.system import System
from navloom.messages import Command, Message, StepReport
from navloom.messages.codec import decode
from navloom_live.hosting.live_robot import LiveRobot, StartError
from navloom_live.hosting.network import network_of
from navloom_live.live.requests import SUBMIT, Submit
from navloom_live.operating.client import Client

PROCESSES = (
    'live.processes={robot=["platform", "localizer"], think=["mapper", "planner", "goal"], '
    'follow=["reference", "recovery"], control=["controller"], avoid=["avoider"], safe=["gate"]}'
)
STAGES = {
    "platform": "odometry",
    "localizer": "pose",
    "goal": STEP,
    "reference": "reference",
    "controller": "command",
    "avoider": "command",
    "gate": "command",
}
"""Role and port of each stage between a stamp and the command that derives from it, in order. The goal's stage is the
report of its step, because the reference waits for that."""
START = 60.0
"""Longest start of the robot, s."""
GOALS = ((0.0, 7.6), (0.0, 0.0))
"""Goals, visited in turn, map frame, m."""
ASK = 2.0
"""Time between readings of the platform's own record, s."""


@dataclass
class Watch:
    """Records messages without decoding them.

    Attributes:
        heard: Of each message, its arrival on this host's monotonic clock, ns, key, bytes and schema label.
    """

    heard: list[tuple[int, str, bytes, str]] = field(default_factory=list)

    def receive(self, key: str, data: bytes | None, label: str) -> None:
        """Store a message; called on the network's thread."""
        if data is not None:
            self.heard.append((time.monotonic_ns(), key, data, label))


def drive(system: System, seconds: float, say: Callable[[str], None]) -> tuple[Watch, int, list[dict[str, float]]]:
    """Drive to and fro for some seconds.

    Returns:
        The recorded messages, the time of run clock 0 on the monotonic clock, ns, and the platform's own record.
    """
    watch, own = Watch(), []
    platform = system.config.platform.instance
    with LiveRobot(system, network_of(system.config, None, False), None, False, say) as robot:
        robot.wait_complete(START)
        client = Client(robot.bus, robot.keys)
        for role, own_port in STAGES.items():
            name = _instance(system, role)
            for port in {own_port, STEP}:
                robot.bus.subscribe(robot.keys.port(role, name, port), watch.receive)
        limit, goal, asked = time.monotonic() + seconds, 0, 0.0
        while time.monotonic() < limit:
            robot.supervisor.poll()
            if goal == 0 or _is_idle(client):
                x, y = GOALS[goal % len(GOALS)]
                client.call("goal", "main", SUBMIT, Submit(x, y))
                goal += 1
            if time.monotonic() - asked > ASK:
                asked = time.monotonic()
                own += _own_record(client, platform)
            time.sleep(0.2)  # only the pace of this loop; the measurement does not depend on it
        return watch, robot.started_ns, own


def _instance(system: System, role: str) -> str:
    return "main" if role in ("goal", "reference", "gate") else system.config.role_table(role).instance


def _is_idle(client: Client) -> bool:
    feedback = client.last("goal", "main", "feedback")
    return feedback is not None and not getattr(feedback, "goal_id", 0)


def _own_record(client: Client, platform: str) -> list[dict[str, float]]:
    """Median and p99 of the ages of the last 256 commands, s, as measured by the platform's process; empty before."""
    for node in client.describe():
        if (node.role, node.instance) == ("platform", platform):
            found = node.streams.get("gate/main/command")
            is_known = found is not None and found.age_p50_s is not None
            return [{"p50": found.age_p50_s, "p99": found.age_p99_s}] if is_known else []
    return []


def evaluate(watch: Watch, start_ns: int, period: float) -> dict[str, Any]:
    """Ages of the commands that move the robot, ms, and the share of each stage."""
    arrived: dict[str, dict[int, int]] = defaultdict(dict)
    spent: dict[str, dict[int, int]] = defaultdict(dict)
    moving: list[tuple[int, int, int]] = []
    for at, key, data, label in watch.heard:
        role = key.split("/")[2]
        message, envelope = decode(data, label)
        if isinstance(message, StepReport) and message.trigger:
            spent[role][envelope.tick] = message.duration_ns
        if key.endswith(f"/{STAGES[role]}"):
            arrived[role].setdefault(envelope.tick, at - start_ns - envelope.cause_ns)
        if role == "gate" and _moves(message):
            moving.append((at, envelope.tick, at - start_ns - envelope.cause_ns))
    ticks = sorted({tick for _, tick, _ in moving})
    return {
        "period_s": period,
        "commands": len(moving),
        "seconds": round((moving[-1][0] - moving[0][0]) * 1e-9, 1) if moving else 0.0,
        "age_ms": _spread([age for _, _, age in moving]),
        "late_share": round(sum(age > period * 1e9 for _, _, age in moving) / max(1, len(moving)), 5),
        "compute_ms": _spread([sum(spent[role].get(tick, 0) for role in STAGES) for tick in ticks]),
        "stages": {
            role: {
                "age_ms": _spread([arrived[role][tick] for tick in ticks if tick in arrived[role]]),
                "step_ms": _spread([spent[role][tick] for tick in ticks if tick in spent[role]]),
            }
            for role in STAGES
        },
    }


def _moves(message: Message) -> bool:
    return isinstance(message, Command) and (message.twist.vx != 0.0 or message.twist.wz != 0.0)


def _spread(values_ns: Sequence[int]) -> dict[str, float]:
    """p50, p90, p99 and maximum, ms."""
    if not values_ns:
        return {}
    ordered = sorted(values_ns)
    found = {f"p{p}": ordered[min(len(ordered) - 1, len(ordered) * p // 100)] for p in (50, 90, 99)}
    return {name: round(value * 1e-6, 3) for name, value in (found | {"max": ordered[-1]}).items()}


def run(period: float, seconds: float, overrides: Sequence[str], say: Callable[[str], None]) -> dict[str, Any]:
    """Measure one robot at one control period."""
    name = f"robot.name=bench{os.getpid()}"
    limit = f"run.stop_after={seconds + START:g}"
    loaded = load_config("paper", [f"run.period={period:g}", limit, name, PROCESSES, *overrides])
    watch, start_ns, own = drive(assemble(loaded), seconds, say)
    found = evaluate(watch, start_ns, period)
    middle = sorted(entry["p50"] for entry in own)
    found["platforms_own_ms"] = {
        "p50": round(1e3 * middle[len(middle) // 2], 3),
        "worst_p99": round(1e3 * max(entry["p99"] for entry in own), 3),
    } if own else {}  # fmt: skip
    return found


def as_text(found: dict[str, Any]) -> str:
    """A table for people."""

    def row(name: str, entry: dict[str, float]) -> str:
        return f"{name:34}" + "".join(f"{entry.get(p, float('nan')):9.2f}" for p in ("p50", "p90", "p99", "max"))

    lines = [
        f"period {found['period_s'] * 1e3:g} ms: {found['commands']} moving commands in {found['seconds']} s",
        f"{'ms':34}" + "".join(f"{p:>9}" for p in ("p50", "p90", "p99", "max")),
        row("stamp to command", found["age_ms"]),
        row("  of it computing in steps", found["compute_ms"]),
    ]
    for role, stage in found["stages"].items():
        lines.append(row(f"  stamp to {role} {STAGES[role]}", stage["age_ms"]))
        lines.append(row("    its step", stage["step_ms"]))
    lines.append(f"older than a period: {100 * found['late_share']:.2f} %")
    lines.append(f"the platform's own record, ms: {found['platforms_own_ms']}")
    return "\n".join(lines)


def main() -> int:
    """Exit code: 1 if the robot did not drive, 2 if the request was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print a line of JSON for each period")
    parser.add_argument("--period", type=float, action="append", metavar="S", help="repeats (default 0.05 and 0.02)")
    parser.add_argument("--seconds", type=float, default=45.0, help="length of the drive, s (default 45)")
    parser.add_argument("--set", action="append", default=[], metavar="A.B=V", help="change the config; repeats")
    given = parser.parse_args()
    code = 0
    with tempfile.TemporaryDirectory(prefix="nl") as folder:
        os.environ.setdefault("NAVLOOM_RUNTIME_DIR", folder)
        for period in given.period or (0.05, 0.02):
            try:
                found = run(period, given.seconds, given.set, lambda text: print(text, file=sys.stderr))
            except (ConfigError, StartError) as error:
                print(f"stamp_to_command: {error}", file=sys.stderr)
                return 2
            print(json.dumps(found) if given.json else as_text(found) + "\n", flush=True)
            code = code or int(not found["commands"])
    return code


if __name__ == "__main__":
    sys.exit(main())
