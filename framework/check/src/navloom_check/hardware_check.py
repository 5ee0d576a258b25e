"""Checks the platform of a config with its real hardware: its reports, their timing and, on request, its driving."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from navloom.config import ConfigError, Loaded, load_config
from navloom.engine.answer_checks import AnswerError, PlatformDoor
from navloom.engine.build import assemble
from navloom.engine.plugin_factory import make_plugins
from navloom.engine.system import System
from navloom.messages import Pose2D, Twist2D
from navloom.plugins import Discovery
from navloom.roles import Platform, PlatformInput, PlatformOutput

from navloom_check.findings import CheckReport, Finding, Remark, Result

__all__ = ["HARDWARE", "check_hardware"]

HARDWARE = "hardware"
"""Tier of these checks."""
LISTENING, DRIVING = 3.0, 1.5
"""Time for which the platform is observed at rest, and for which it drives each way, s."""
GENTLE, TURNING = 0.1, 0.3
"""Speed and turn rate of the drive, m/s and rad/s, unless a quarter of the robot's limit is less."""
STILL = Twist2D(0.0, 0.0, 0.0)
REST, REST_TURN = 0.01, 0.02
"""Greatest motion by odometry while zero is commanded, m and rad."""
CLOSING = 2.0
"""Longest `close`, s."""
Found = Finding | Remark


@dataclass
class _Heard:
    """Reports of a platform that was called each tick.

    Attributes:
        outputs: Outputs, each with the run clock at which it came, ns.
        faults: Errors of `advance` and `drive`.
        calls: Duration of each of their calls, s.
    """

    outputs: list[tuple[int, PlatformOutput]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    calls: list[float] = field(default_factory=list)

    @property
    def poses(self) -> list[Pose2D]:
        """Poses by odometry."""
        return [output.odometry.pose for _, output in self.outputs]


def check_hardware(
    config: str, name: str, changes: Sequence[str] = (), drives: bool = False, say: Callable[[str], None] = print
) -> CheckReport:
    """Check the platform of a config. Only zero is commanded unless `drives`.

    Args:
        config: Path or shipped name.
        name: The platform that the config must name, as `platform.serial_base`.
        changes: Parameters of the platform, as `port="/dev/ttyUSB0"`.
        drives: Drive a short way forward, turn, and check that the robot stops.
        say: Called with one line before each part.

    Raises:
        ConfigError: The config names another platform, or a simulated one.
    """
    loaded = load_config(config, [f"platform.{change}" for change in changes])
    plugin = f"platform.{loaded.config.platform.plugin}"
    if name != plugin:
        raise ConfigError(f"--hardware {config}: its platform is {plugin}, expected {name}")
    system = assemble(loaded, Discovery(loaded.config.plugins.blocked))
    source = ("platform", loaded.config.platform.instance)
    part = system.parts[source]
    if part.cls.is_simulated:  # type: ignore[attr-defined]
        raise ConfigError(f"{name}: is simulated and has no hardware: leave out --hardware")
    make_plugins(system, lambda text: None, {source})
    platform = system.plugin(*source)
    assert isinstance(platform, Platform)
    trial = _Trial(system, loaded, platform, say)
    results = list(trial.run(drives))
    options = (f"--hardware {Path(config)}", *(f"--set {change}" for change in changes), *["--drive"] * drives)
    return CheckReport(name, "", "", loaded.config.run.seed, tuple(results), options)


class _Trial:
    """The checks of one platform."""

    def __init__(self, system: System, loaded: Loaded, platform: Platform, say: Callable[[str], None]) -> None:
        self.robot, self.platform, self.say = system.robot, platform, say
        self.period, self.deadline = loaded.config.run.period, loaded.config.gate.stop_deadline
        self.sensors = [spec.name for spec in system.sensors]
        self._door, self._began, self._tick = PlatformDoor(platform, system.sensors), time.monotonic(), 0

    def run(self, drives: bool) -> Iterator[Result]:
        """Run the checks in turn; the platform is always closed at the end."""
        try:
            self.say(f"listening for {LISTENING:g} s; the robot does not move")
            heard = self._play(STILL, LISTENING)
            yield self._result("reports", self._reports(heard))
            yield self._result("timely", self._timely(heard))
            yield self._result("fresh", self._fresh(heard))
            yield self._result("stands", self._stands(heard))
            yield self._result("sensors", self._sensors(heard))
            for check, run in (("drives", self._drives), ("turns", self._turns), ("stops_alone", self._stops_alone)):
                is_able = drives and bool(heard.outputs)
                reason = "it reported nothing" if drives else "it would move the robot: add --drive"
                yield self._result(check, run()) if is_able else Result(check, HARDWARE, "not_run", reason=reason)
        finally:
            closing = self._closes()
        yield self._result("closes", closing)

    def _result(self, check: str, found: Sequence[Found]) -> Result:
        findings = tuple(one for one in found if isinstance(one, Finding))
        shown = tuple(one for one in found if isinstance(one, Remark))
        return Result(check, HARDWARE, "failed" if findings else "passed", findings, shown)

    def _play(self, command: Twist2D, seconds: float, is_told: bool = True) -> _Heard:
        """Call the platform as a live robot does, at the control tick."""
        heard, ends = _Heard(), self._tick + max(1, round(seconds / self.period))
        while self._tick < ends:
            self._tick += 1
            time.sleep(max(0.0, self._began + self._tick * self.period - time.monotonic()))
            at_ns = round(self._tick * self.period * 1e9)
            begun = time.monotonic()
            try:
                given = PlatformInput(command if is_told else STILL, None, at_ns)
                if is_told:
                    self.platform.drive(command, at_ns)
                    heard.calls.append(time.monotonic() - begun)
                    begun = time.monotonic()
                output = self._door.check(self.platform.advance(given), given)
                heard.outputs.append((at_ns, output))
            except AnswerError as error:
                heard.faults.append(str(error))
            except Exception as error:
                heard.faults.append(f"{type(error).__name__}: {error}")
            heard.calls.append(time.monotonic() - begun)
        return heard

    def _reports(self, heard: _Heard) -> list[Found]:
        if not heard.outputs:
            why = heard.faults[-1] if heard.faults else "it was silent"
            return [Finding(f"reported nothing in {LISTENING:g} s: {why}", "odometry each tick: see cable and power")]
        late = [
            fault for fault in heard.faults[len(heard.faults) // 2 :] if len(heard.faults) > LISTENING / self.period / 2
        ]
        if late:
            return [Finding(f"failed in {len(heard.faults)} ticks, the last: {late[-1]}", "a report each tick")]
        return [Remark(f"{len(heard.outputs)} reports, {len(heard.faults)} ticks without one")]

    def _timely(self, heard: _Heard) -> list[Found]:
        calls = np.array(heard.calls[2:] or heard.calls)
        worst, limit = float(calls.max()), self.deadline / 2.0
        shown = Remark(f"calls took {1e3 * float(np.median(calls)):.1f} ms at the median, {1e3 * worst:.1f} ms at most")
        if worst <= limit:
            return [shown]
        expected = f"at most {1e3 * limit:.0f} ms, half of gate.stop_deadline: read the port in a thread"
        return [shown, Finding(f"took {1e3 * worst:.0f} ms in a call of drive or advance", expected)]

    def _fresh(self, heard: _Heard) -> list[Found]:
        if not heard.outputs:
            return []
        ages = np.array([at_ns - output.odometry.stamp_ns for at_ns, output in heard.outputs]) * 1e-9
        shown = Remark(
            f"odometry was {1e3 * float(np.median(ages)):.0f} ms old at the median, {1e3 * ages.max():.0f} at most"
        )
        if float(np.median(ages)) <= self.deadline:
            return [shown]
        expected = f"at most {1e3 * self.deadline:.0f} ms, gate.stop_deadline"
        return [shown, Finding(f"gave odometry that is {1e3 * float(np.median(ages)):.0f} ms old", expected)]

    def _stands(self, heard: _Heard) -> list[Found]:
        if not heard.poses:
            return []
        way, turn = _moved(heard.poses[0], heard.poses[-1])
        if abs(way) <= REST and abs(turn) <= REST_TURN:
            return []
        return [Finding(f"moved {way:.3f} m and {turn:.3f} rad by its odometry while zero was commanded",
                        "a stopped robot, and odometry that does not change")]  # fmt: skip

    def _sensors(self, heard: _Heard) -> list[Found]:
        found: list[Found] = []
        for name in self.sensors:
            count = sum(name in output.scans for _, output in heard.outputs)
            if count:
                found.append(Remark(f"{name}: {count / LISTENING:.1f} Hz"))
            else:
                found.append(Finding(f"gave nothing of the sensor {name}", f"a message within {LISTENING:g} s"))
        return found

    def _drives(self) -> list[Found]:
        speed = min(GENTLE, self.robot.max_linear / 4.0)
        self.say(f"driving {speed:g} m/s for {DRIVING:g} s")
        return self._moves(Twist2D(speed, 0.0, 0.0), speed, 0, "m/s forward")

    def _turns(self) -> list[Found]:
        speed = min(TURNING, self.robot.max_angular / 4.0)
        self.say(f"turning {speed:g} rad/s to the left for {DRIVING:g} s")
        return self._moves(Twist2D(0.0, 0.0, speed), speed, 1, "rad/s to the left")

    def _moves(self, command: Twist2D, speed: float, axis: int, unit: str) -> list[Found]:
        """Drive, stop, and compare with odometry; `axis` is 0 for the distance and 1 for the turn."""
        driven, stopped = self._play(command, DRIVING), self._play(STILL, 1.0)
        found: list[Found] = []
        if len(driven.poses) < 2 or len(stopped.poses) < 2:
            why = (driven.faults + stopped.faults or ["no odometry"])[-1]
            return [Finding(f"could not be driven: {why}", "odometry while it drives")]
        expected = speed * self.period * (len(driven.poses) - 1)
        share = _moved(driven.poses[0], driven.poses[-1])[axis] / expected
        found.append(Remark(f"odometry shows {share:.0%} of the {speed:g} {unit} that were commanded"))
        if not 0.5 <= share <= 1.2:
            found.append(Finding(f"moved {share:.0%} of {expected:.2f} at {speed:g} {unit}, by its odometry",
                                 "50 to 120 %: see sign, wheels and ticks_per_turn"))  # fmt: skip
        after = stopped.poses[len(stopped.poses) // 2 :]
        if abs(_moved(after[0], after[-1])[axis]) > (REST, REST_TURN)[axis]:
            found.append(Finding("still moved 0.5 s after zero was commanded", "a stop at once"))
        return found

    def _stops_alone(self) -> list[Found]:
        """Stop calling the platform while the robot drives, as if its loop hung: it must stop by itself."""
        speed = min(GENTLE, self.robot.max_linear / 4.0)
        self.say(f"driving {speed:g} m/s for 0.5 s, and then sending nothing")
        self._play(Twist2D(speed, 0.0, 0.0), 0.5)
        self._tick += max(1, round(1.0 / self.period))  # nothing is called for a second
        first = self._play(STILL, self.period, is_told=False)
        second = self._play(STILL, 0.5, is_told=False)
        self._play(STILL, 0.2)
        if not first.poses or not second.poses:
            return [
                Finding(f"gave no odometry: {(first.faults + second.faults or [''])[-1]}", "odometry after the silence")
            ]
        way, _ = _moved(first.poses[-1], second.poses[-1])
        if abs(way) <= REST:
            return []
        return [Finding(f"drove on for {way:.2f} m in 0.5 s though nothing was called for 1 s",
                        "a watchdog in the driver or the base that stops it within 0.5 s")]  # fmt: skip

    def _closes(self) -> list[Found]:
        """Command zero and call `close`, as at the end of a live robot; in a thread, since `close` may hang."""
        errors: list[str] = []

        def close() -> None:
            with suppress(Exception):  # the port may be gone already
                self.platform.drive(STILL, round((self._tick + 1) * self.period * 1e9))
            try:
                self.platform.close()
            except Exception as error:
                errors.append(f"{type(error).__name__}: {error}")

        thread = threading.Thread(target=close, daemon=True)
        thread.start()
        thread.join(CLOSING)
        if thread.is_alive():
            return [Finding(f"close() took more than {CLOSING:g} s", "its thread and its port closed at once")]
        return [Finding(f"close() raises {error}", "no error, and its ports released") for error in errors]


def _moved(before: Pose2D, after: Pose2D) -> tuple[float, float]:
    """Distance along the first heading, m, and turn, rad."""
    way = (after.x - before.x) * math.cos(before.heading) + (after.y - before.y) * math.sin(before.heading)
    return way, math.remainder(after.heading - before.heading, math.tau)
