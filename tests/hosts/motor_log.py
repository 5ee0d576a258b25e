"""A platform for tests: the simulated robot, which logs each command to its motors in a file."""

from __future__ import annotations

import os
import time
from pathlib import Path

from navloom import PlatformInput, PlatformOutput, Registry, Twist2D, hookimpl
from navloom_sensors_sim.adapter import SensorsSim
from navloom_sensors_sim.params import SensorsSimParams
from pydantic import Field

__all__ = ["MotorLog", "install"]


class MotorLogParams(SensorsSimParams):
    """Parameters of the simulated robot, and the file of its log."""

    motor_log: str = Field(description="file that each command to the motors is added to")


class MotorLog(SensorsSim):
    """The simulated robot with a log. A line is: monotonic time in ns, forward speed in m/s, turn rate in rad/s.

    A line that begins with `at` is the true state after a tick: time in ns, speed, turn rate, contact, x, y.
    """

    name = "motor_log"
    Params = MotorLogParams

    def reset(self) -> None:
        """Back to the start of the run."""
        super().reset()
        self._log = os.open(self.params.motor_log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)

    def drive(self, command: Twist2D, time_ns: int) -> None:
        """Log a command, and pass it to the wheels."""
        os.write(self._log, b"%d %.6f %.6f\n" % (time.monotonic_ns(), command.vx, command.wz))
        super().drive(command, time_ns)

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Advance, and log the true state."""
        output = super().advance(given)
        truth = output.truth
        if truth is not None:
            pose, twist = truth.pose, truth.twist
            values = (time.monotonic_ns(), twist.vx, twist.wz, truth.touching, pose.x, pose.y)
            os.write(self._log, b"at %d %.6f %.6f %d %.4f %.4f\n" % values)
        return output


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Adds the platform."""
    registry.add(MotorLog)


def install(folder: Path) -> str:
    """Make the platform appear installed to processes whose PYTHONPATH is the returned text.

    Args:
        folder: Empty folder for its metadata.
    """
    about = folder / "motor_log-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: motor-log\nVersion: 1.0\n", "utf-8")
    (about / "entry_points.txt").write_text("[navloom]\nplatform.motor_log = motor_log\n", "utf-8")
    return f"{folder}{os.pathsep}{Path(__file__).parent}"
