"""Certificates that are renewed, replaced and revoked while a robot behind a TLS router drives at full speed.

`python tests/faults/certificate_campaign.py --count 20` prints the effects on the motors as a table.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import socket
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import zenoh
from fault_rig import FULL, Rig, rig, until
from navloom_live.transport.access import Identity
from navloom_live.transport.certificate_folder import add_identity, new_authority, renew, revoke
from navloom_live.transport.certificates import HOSTS, CertificateRequest
from navloom_live.transport.links import Link, settings

__all__ = ["KINDS", "Certificates", "Outcome", "certificates", "table"]

WATCHED = 8.0
"""How long a robot is watched without a change, s."""
DONE = "all connections use the new certificates"
DAYS = 60
TRIES = 20
"""Commands and queries that a revoked operator sends."""


@dataclass(frozen=True)
class Outcome:
    """Effects of one change.

    Attributes:
        took: Time until the router used the new certificates, s.
        zeros: Stop commands to the motors.
        slowest: Lowest speed of the robot meanwhile, m/s.
        below: Time below 90 % of full speed, s.
        restarts: Restarts of any process.
        locked_out: Time from the revocation to the owner's last answer, s; None for other changes.
        touched: Something was touched.
    """

    took: float
    zeros: int
    slowest: float
    below: float
    restarts: int
    locked_out: float | None
    touched: bool


class Certificates:
    """A robot that drives, and the folder of its certificates. Use `certificates`."""

    def __init__(self, robot: Rig, folder: Path, end: str) -> None:
        self.robot, self.folder, self.end = robot, folder, end

    def change(self, kind: str) -> Outcome:
        """Make one change while the robot drives at full speed."""
        robot = self.robot
        if kind == "revoke an operator":
            add_identity(self.folder, Identity("bob", "operator"), (), DAYS, datetime.now(UTC))
            self._await_router(self._changes())
        robot.wait_full_speed()
        restarts = self._restarts()
        began_ns, began = time.monotonic_ns(), time.monotonic()
        locked_out = KINDS[kind](self)
        took = time.monotonic() - began
        ticks = [tick for tick in robot.motors.look().ticks if tick.time_ns > began_ns]
        words = robot.motors.between(began_ns, time.monotonic_ns())
        period = (ticks[-1].time_ns - ticks[0].time_ns) * 1e-9 / (len(ticks) - 1)
        return Outcome(
            took,
            sum(not word.turns for word in words),
            min(abs(tick.speed) for tick in ticks),
            sum(abs(tick.speed) < 0.9 * FULL for tick in ticks) * period,
            self._restarts() - restarts,
            locked_out,
            robot.motors.touched,
        )

    def nothing(self) -> None:
        """For comparison: no change, to measure the disturbance of a shared machine."""
        time.sleep(WATCHED)

    def renew_all(self) -> None:
        before = self._changes()
        renew(self.folder, (), (), DAYS, datetime.now(UTC))
        self._await_router(before)

    def replace_nodes(self) -> None:
        """Revoke and replace the robot's own certificate."""
        before = self._changes()
        revoke(self.folder, "nodes", datetime.now(UTC), DAYS)
        self._await_router(before)

    def revoke_operator(self) -> float:
        """Revoke an operator, who then tries everything he was allowed; returns the time until he was locked out, s."""
        before, kept = self._changes(), self.folder.parent / "kept"
        shutil.copytree(self.folder, kept)
        try:
            with self._hostile(self.folder) as bob:
                assert self._hears(bob), "an operator that is not revoked gets answers"
                began = time.monotonic()
                revoke(self.folder, "bob", datetime.now(UTC))
                last = began
                while time.monotonic() - last < 1.5:
                    if self._hears(bob):
                        last = time.monotonic()
                self._abuse(bob)
            self._await_router(before)
            with self._hostile(kept) as again:
                self._abuse(again)
        finally:
            shutil.rmtree(kept)
        return last - began

    def kill_router(self) -> None:
        """For comparison: kill the router, which is restarted."""
        os.kill(self.robot.pids()["router"], 9)
        time.sleep(WATCHED)

    def stop_router(self) -> None:
        """For comparison: stop the router with SIGSTOP for a while, then continue it."""
        router = self.robot.pids()["router"]
        os.kill(router, signal.SIGSTOP)
        time.sleep(WATCHED / 2)
        os.kill(router, signal.SIGCONT)
        time.sleep(WATCHED / 2)

    @contextmanager
    def _hostile(self, folder: Path) -> Iterator[zenoh.Session]:
        """A session of bob that only the router restricts."""
        given = settings(Link("client", (), (self.end,), folder, "bob"))
        with zenoh.open(zenoh.Config.from_json5(json.dumps(given))) as session:
            yield session

    def _hears(self, session: zenoh.Session) -> bool:
        with suppress(zenoh.ZError):
            return any(reply.ok is not None for reply in session.get("lab/r1/gate/main/describe", timeout=0.3))
        return False

    def _abuse(self, session: zenoh.Session) -> None:
        """Send commands and queries, none of which may reach the robot."""
        for _ in range(TRIES):
            for service in ("gate/main/stop", "goal/main/cancel"):
                with suppress(zenoh.ZError):
                    assert not [r for r in session.get(f"lab/r1/{service}", payload=b"{}", timeout=0.02) if r.ok]
            with suppress(zenoh.ZError):
                session.put("lab/r1/operator/main/command", b"x")
                session.put("lab/r1/gate/main/command", b"x")
                session.put("lab/r1/@router/moved", b"")

    def _changes(self) -> int:
        return (self.robot.folder / "rt" / "lab.r1" / "router.log").read_text("utf-8").count(DONE)

    def _await_router(self, before: int) -> None:
        until(lambda: self._changes() > before, 30.0, "the router has changed over")
        time.sleep(0.5)

    def _restarts(self) -> int:
        fates = json.loads((self.robot.folder / "rt" / "lab.r1" / "fates.json").read_text("utf-8"))
        return sum(fate["restarts"] for fate in fates.values())


KINDS: dict[str, Callable[[Certificates], float | None]] = {
    "nothing": Certificates.nothing,
    "renew all": Certificates.renew_all,
    "replace nodes": Certificates.replace_nodes,
    "revoke an operator": Certificates.revoke_operator,
    "router killed": Certificates.kill_router,
    "router stopped": Certificates.stop_router,
}


@contextmanager
def certificates() -> Iterator[Certificates]:
    """A robot that drives behind a TLS router on loopback; always ended on exit."""
    with TemporaryDirectory(prefix="nk", dir="/tmp") as place:
        folder = Path(place) / "keys"
        new_authority(folder, CertificateRequest("lab", "r1", HOSTS, DAYS, datetime.now(UTC)))
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            end = f"tls/127.0.0.1:{probe.getsockname()[1]}"
        with rig(f'router = "{end}"\nkeys = "{folder}"\n') as robot:
            yield Certificates(robot, folder, end)


def table(outcomes: dict[str, list[Outcome]]) -> str:
    """Distribution of each kind, as median (maximum)."""

    def spread(values: list[float], form: str = ".1f") -> str:
        return f"{statistics.median(values):{form}} ({max(values):{form}})" if values else ""

    rows = [
        "| change | n | done, s | stops | slowest, m/s | below full speed, s | restarts | locked out, s | contact |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind, found in outcomes.items():
        rows.append(
            f"| {kind} | {len(found)} | {spread([one.took for one in found])} | {sum(one.zeros > 0 for one in found)} "
            f"| {min(one.slowest for one in found):.2f} | {spread([one.below for one in found], '.2f')} "
            f"| {sum(one.restarts for one in found)} "
            f"| {spread([one.locked_out for one in found if one.locked_out is not None])} "
            f"| {sum(one.touched for one in found)} |"
        )
    return "\n".join(rows)


def main() -> None:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--only", default="", help="changes whose name holds this")
    given = parser.parse_args()
    outcomes: dict[str, list[Outcome]] = {kind: [] for kind in KINDS if given.only in kind}
    with certificates() as running:
        for number in range(given.count):
            for kind, outcome in outcomes.items():
                outcome.append(running.change(kind))
                print(f"{number + 1} {kind}: {outcome[-1]}, load {os.getloadavg()[0]:.1f}", flush=True)
    print(table(outcomes))


if __name__ == "__main__":
    main()
