"""Injects network faults, each many times, into a robot on four hosts that drives to and fro over a slow cable.

`python tests/hosts/host_campaign.py --times 20` prints the effects on the motors as a table.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

from four_hosts import FOUR, NAMES, Robot
from host_rig import Lab, Slow, lab, until
from motor_words import Fault, MotorWords
from wall_clocks import WallClocks, why_no_clocks

__all__ = ["FAULTS", "Campaign", "Outcome", "campaign", "table"]

CUT = 3.0
"""How long a cable stays cut, s."""
FULL = 0.35
"""Speed from which the robot counts as at full speed, m/s; its reference is 0.4 on straights."""
STATUS_INTERVAL = 2.0
"""How long the motors are watched after a fault that must not stop them, s."""
HOUR = 3600.0
PLACES = ("0,7.6", "0,0")


@dataclass(frozen=True)
class Outcome:
    """Effects of one fault: on the motors, whether the robot touched something, and how goals ended meanwhile."""

    fault: Fault
    touched: bool
    ended: tuple[str, ...]


@dataclass
class Campaign:
    """A robot that drives to and fro.

    Attributes:
        lab, robot, motors: Its hosts, the robot, and the log of its motors.
        clocks: Wall clocks of the hosts; None where they cannot be set.
        chance: Random delays that spread the faults over a tick and a lease.
    """

    lab: Lab
    robot: Robot
    motors: MotorWords
    clocks: WallClocks | None
    chance: random.Random = field(default_factory=lambda: random.Random(7))

    def __post_init__(self) -> None:
        self._shuttle = self.robot.shuttle(*PLACES)
        self._ahead = dict.fromkeys(FOUR, 0.0)

    def inject(self, name: str) -> Outcome:
        """Inject one fault at full speed."""
        until(self._is_fast, 180, f"{FULL} m/s before: {name}; {self._shuttle.said[-3:]}")
        said = len(self._shuttle.said)
        fault = FAULTS[name](self)
        return Outcome(fault, self.motors.touched, tuple(self._shuttle.said[said:]))

    def cut(self, host: str) -> Fault:
        """Pull a host's cable, and put it back."""
        began = time.monotonic()
        self.lab.cut(host)
        time.sleep(CUT)
        self.lab.mend(host)
        return self._until_again(began, time.monotonic())

    def kill_router(self) -> Fault:
        """Send SIGKILL to the router, which `navloom up` restarts."""
        up = self.robot.programs["hub"].process.pid
        children = Path(f"/proc/{up}/task/{up}/children").read_text("ascii").split()
        began = time.monotonic()
        for child in children:
            os.kill(int(child), signal.SIGKILL)
        return self._until_again(began, time.monotonic())

    def jump(self, host: str) -> Fault:
        """Set a host's wall clock an hour ahead or, if it is ahead, back."""
        assert self.clocks is not None
        self._ahead[host] = HOUR - self._ahead[host]
        self.clocks.set(host, self._ahead[host])
        return self.look_on()

    def look_on(self) -> Fault:
        """Observe without a fault, to measure the disturbance of a shared machine."""
        began = time.monotonic()
        time.sleep(STATUS_INTERVAL)
        self.motors.look()
        return self.motors.fault(began, began, time.monotonic())

    def _until_again(self, began: float, ended: float) -> Fault:
        motors = self.motors
        until(lambda: motors.turned_after(ended), 60, f"the robot drives again; {self._shuttle.said[-3:]}")
        return motors.fault(began, ended, time.monotonic())

    def _is_fast(self) -> bool:
        if self.motors.speed < FULL:
            return False
        time.sleep(self.chance.uniform(0.0, 0.25))
        return self.motors.speed >= FULL


FAULTS: dict[str, Callable[[Campaign], Fault]] = {
    **{f"cut {host}": (lambda given, host=host: given.cut(host)) for host in FOUR},  # type: ignore[misc]
    "router killed": Campaign.kill_router,
    "none": Campaign.look_on,
    **{f"clock {host}": (lambda given, host=host: given.jump(host)) for host in FOUR},  # type: ignore[misc]
}


@contextmanager
def campaign(is_secure: bool = True) -> Iterator[Campaign]:
    """A robot on four hosts that drives; ended on exit."""
    with lab(*NAMES, slow={"brain": Slow()}) as hosts:
        clocks = None if why_no_clocks() else WallClocks(hosts)
        robot = Robot(hosts, secure=is_secure)
        robot.bring_up()
        given = Campaign(hosts, robot, MotorWords(robot.motors), clocks)
        try:
            yield given
        except BaseException:
            for name, program in robot.programs.items():
                print(f"{name} said last:", *program.said[-12:], sep="\n  ", file=sys.stderr)
            raise


def table(outcomes: dict[str, list[Outcome]]) -> str:
    """Distribution of each fault, as median (maximum)."""

    def spread(values: list[float | None], unit: float) -> str:
        known = sorted(value for value in values if value is not None)
        return f"{statistics.median(known) * unit:.3g} ({known[-1] * unit:.3g})" if known else "-"

    rows = [
        "| fault | times | stopped | motors ran on, ms | to zero, ms | to standstill, ms | drove again, s | contacts |"
        " goals that ended otherwise |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, outcome in outcomes.items():
        faults = [one.fault for one in outcome]
        ended = sorted({text for one in outcome for text in one.ended if not text.startswith("succeeded")})
        rows.append(
            f"| {name} | {len(outcome)} | {sum(fault.stopped is not None for fault in faults)} "
            f"| {spread([fault.ran_on for fault in faults], 1e3)} | {spread([fault.stopped for fault in faults], 1e3)} "
            f"| {spread([fault.stood for fault in faults], 1e3)} | {spread([fault.again for fault in faults], 1.0)} "
            f"| {sum(one.touched for one in outcome)} | {'; '.join(ended) or 'none'} |"
        )
    return "\n".join(rows)


def main() -> None:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--only", default="", help="faults whose name holds this")
    parser.add_argument("--plain", action="store_true", help="plain TCP instead of TLS")
    parser.add_argument("--out", type=Path, help="file for every outcome, as JSON")
    given = parser.parse_args()
    outcomes: dict[str, list[Outcome]] = {name: [] for name in FAULTS if given.only in name}
    with campaign(not given.plain) as running:
        for number in range(given.times):
            for name, found in outcomes.items():
                found.append(running.inject(name))
                print(f"{number + 1} {name}: {found[-1]}", file=sys.stderr, flush=True)
                if given.out is not None:
                    kept = {one: [asdict(outcome) for outcome in rows] for one, rows in outcomes.items()}
                    given.out.write_text(json.dumps(kept), "utf-8")
    print(table(outcomes))


if __name__ == "__main__":
    main()
