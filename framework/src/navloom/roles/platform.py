"""Platform: the robot itself, real or simulated."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from navloom.geometry.world import World
from navloom.messages import Contact, Message, Odometry, SweepRequest, Truth, Twist2D
from navloom.roles.base import P, Params, Role, SensorSpec
from navloom.roles.struct import struct

__all__ = ["Platform", "PlatformInput", "PlatformOutput"]


@struct
class PlatformInput:
    """What a platform is asked for in a tick.

    Attributes:
        command: Velocity to drive with until `time_ns`; zero where the gate was silent.
        sweep_request: A new request for a stop-and-scan sweep, once; None otherwise.
        time_ns: Run clock to reach; the first call is for 0 and moves nothing.
    """

    command: Twist2D
    sweep_request: SweepRequest | None
    time_ns: int


@struct
class PlatformOutput:
    """What a platform knows when it has reached the time asked for.

    Attributes:
        odometry: Dead reckoning.
        scans: By sensor name, what was completed since the last call, of the class that the sensor's kind declares; a
            sensor with nothing new is left out.
        contact: Whether it touches something.
        truth: Ground truth; None on a real robot.
    """

    odometry: Odometry
    scans: Mapping[str, Message]
    contact: Contact
    truth: Truth | None


class Platform(Role[P]):
    """Moves the robot and reads its sensors.

    Class attributes:
        sensor_kinds: The kinds of sensor it provides and the message each gives.
        sensor_settings: By kind, what a sensor's table may hold beside its name and kind, so that it is checked early.
        is_simulated: Simulated time may be used; a real platform refuses it.
    """

    role = "platform"
    sensor_kinds: ClassVar[Mapping[str, type[Message]]] = {}
    sensor_settings: ClassVar[Mapping[str, type[Params]]] = {}
    is_simulated: ClassVar[bool] = False

    @classmethod
    def scans_on_request(cls, sensor: SensorSpec) -> bool:
        """Whether a sensor measures only when a SweepRequest asks for it."""
        return False

    @classmethod
    def own_world(cls, params: P) -> World | None:
        """What stands in the simulator that the platform brings along, where it can tell; None for what it is given.

        Start and goal are then checked in it, the shortest way is searched in it, and pictures show it. Its `start`
        and `goal` hold where the config names none. A config with such a platform has no `[world]`. A platform that
        cannot tell drives all the same: what would need a world is left out. Raises ValueError for a scene that
        cannot be used.
        """
        return None

    def drive(self, command: Twist2D, time_ns: int) -> None:
        """Take a velocity between two calls of `advance`, at a run clock. Live only; it holds until the next one.

        A platform that leaves it gets every command with `advance`: then a stop waits for the next tick.
        """

    def close(self) -> None:
        """Give up its ports. Live only: called once, after the last `drive`, when its process ends in order."""

    @abstractmethod
    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Drive with the command until the time asked for, and report.

        Live it must return well within the gate's `stop_deadline`: no other command is handed on meanwhile.
        """
