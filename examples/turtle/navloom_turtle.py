"""The smallest robot: it follows each command immediately and measures no ranges.

A driver of a real robot has the same shape. `advance` sends the command to the motors and returns the readings of the
encoders and sensors; `truth` is then None, and `is_simulated` False. List each kind of range sensor in `sensor_kinds`
with the type of its messages; `advance` puts its newest message into `scans` under the sensor's name in the config.
"""

import math

from navloom import (
    Contact,
    Context,
    Odometry,
    Params,
    Platform,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    Registry,
    Truth,
    hookimpl,
)
from pydantic import Field


class TurtleParams(Params):
    """The robot's only error, as a parameter to try."""

    wheel_error: float = Field(0.0, ge=-0.1, le=0.1, description="Share by which odometry overstates the way driven.")


class Turtle(Platform[TurtleParams]):
    """A unicycle without inertia, in a plane without obstacles."""

    name = "turtle"
    is_simulated = True

    def __init__(self, params: TurtleParams, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        """Put the robot back at its start, at time zero."""
        self._true = self.context.start  # in the map
        self._reckoned = Pose2D(0.0, 0.0, 0.0)  # in the odometry frame, which starts where the robot starts
        self._time_ns = 0

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Drive with the command until the requested time."""
        seconds = (given.time_ns - self._time_ns) * 1e-9
        self._time_ns = given.time_ns
        way, turn = given.command.vx * seconds, given.command.wz * seconds
        self._true = moved(self._true, way, turn)
        self._reckoned = moved(self._reckoned, way * (1.0 + self.params.wheel_error), turn)
        odometry = Odometry(given.time_ns, self._reckoned, given.command)
        truth = Truth(self._true, given.command, math.inf, "", False)
        return PlatformOutput(odometry, {}, Contact(False), truth)


def moved(pose: Pose2D, way: float, turn: float) -> Pose2D:
    """The pose after a short arc, m and rad, by its chord."""
    heading = pose.heading + 0.5 * turn
    x, y = pose.x + way * math.cos(heading), pose.y + way * math.sin(heading)
    return Pose2D(x, y, math.remainder(pose.heading + turn, math.tau))


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the platform; navloom calls this hook through the entry point."""
    registry.add(Turtle)
