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
    """Input of a platform.

    Attributes:
        command: Velocity to drive with until `time_ns`; zero if the gate was silent.
        sweep_request: A new request for a stop-and-scan sweep, once; None otherwise.
        time_ns: Run clock to reach; the first call is for 0 and moves nothing.
    """

    command: Twist2D
    sweep_request: SweepRequest | None
    time_ns: int


@struct
class PlatformOutput:
    """Answer of a platform, at the run clock that it was asked to reach.

    Attributes:
        odometry: Dead reckoning.
        scans: By sensor name, the message that was completed since the last call, of the class that the sensor's kind
            declares; a sensor without a new message is left out.
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
        sensor_kinds: The kinds of sensor that it provides, with the message class of each.
        sensor_settings: By kind, the keys of a sensor's table beside its name and kind, so that they are checked early.
        is_simulated: It may run in simulated time; a real platform may not.
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
        """Obstacles of the platform's own simulator; None if it uses the config's world, or does not know them.

        Start and goal are checked in this world, the shortest path is searched in it, and pictures show it. Its `start`
        and `goal` are used if the config names none. A config with such a platform has no `[world]`. Without a world,
        the robot drives, and results that need one are left out. Raises ValueError for a scene that cannot be used.
        """
        return None

    def drive(self, command: Twist2D, time_ns: int) -> None:
        """Take a velocity between two calls of `advance`, at a run clock. Live only; it holds until the next one.

        A platform without this method gets each command with `advance`; a stop then waits for the next tick.
        """

    def close(self) -> None:
        """Close its ports. Live only: called once, after the last `drive`, on an orderly shutdown."""

    @abstractmethod
    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Drive with the command until `given.time_ns`, and report.

        Live, it must return well within the gate's `stop_deadline`, because it delays the next command.
        """
