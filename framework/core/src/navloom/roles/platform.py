"""Platform: the robot itself, real or simulated."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from navloom.geometry.world import World
from navloom.messages import Bodies, Contact, Message, Odometry, SweepRequest, Truth, Twist2D
from navloom.roles.base import P, Params, Role, SensorSpec
from navloom.roles.claims import Claim
from navloom.roles.facts import RoleFacts
from navloom.roles.struct import struct

__all__ = ["Platform", "PlatformInput", "PlatformOutput"]


@struct
class PlatformInput:
    """What a platform must do in a tick.

    Attributes:
        command: Velocity to drive with until `time_ns`; zero if the gate was silent.
        sweep_request: A request for a stop-and-scan sweep, in one tick only; None otherwise.
        time_ns: Run clock to reach; the first call is for 0 and moves nothing.
        bodies: What moves in the simulated world, this robot included; None where nothing else moves, and on a real
            robot. `Context.world` holds what stands.
        own_body: Number of this robot among the bodies; -1 if it is not one of them.
    """

    command: Twist2D
    sweep_request: SweepRequest | None
    time_ns: int
    bodies: Bodies | None = None
    own_body: int = -1


@struct
class PlatformOutput:
    """What a platform reports when it has reached the requested time.

    Attributes:
        odometry: Dead reckoning.
        scans: By sensor name, the message completed since the last call, of the class that the sensor's kind declares;
            a sensor with nothing new is left out.
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
        sensor_kinds: Message class of each kind of sensor that it provides.
        sensor_settings: By kind, the model of a sensor's other keys, so that they are checked early.
        true_kinds: Kinds that tell the truth of a simulator; an input reads one only if
            the config's `inputs` names the sensor.
        is_simulated: It can run in simulated time, which a real platform cannot.
        takes_disturbances: It is moved, and its wheels slip, as `Context.disturbances` says: the events `displace` and
            `slip` of a config. Only a simulator can; a config with such events and another platform is refused.
    """

    role = "platform"
    facts = RoleFacts(
        called="Moves the robot and reads its sensors: a simulator or a driver. One for each robot.",
        purpose=frozenset({Claim.DRIVES_AS_TOLD}),
        default_plugin="sensors_sim",
        process="robot",
        is_exchangeable=False,
        has_large_messages=True,
    )
    sensor_kinds: ClassVar[Mapping[str, type[Message]]] = {}
    sensor_settings: ClassVar[Mapping[str, type[Params]]] = {}
    true_kinds: ClassVar[frozenset[str]] = frozenset()
    is_simulated: ClassVar[bool] = False
    takes_disturbances: ClassVar[bool] = False

    @classmethod
    def scans_on_request(cls, sensor: SensorSpec) -> bool:
        """Whether a sensor measures only when a SweepRequest asks for it."""
        return False

    @classmethod
    def own_world(cls, params: P) -> World | None:
        """The world of the platform's own simulator; None if it has none or does not know it.

        Start and goal are checked in this world, the shortest path is searched in it, and pictures show it. Its `start`
        and `goal` are used if the config names none. A config with such a platform has no `[world]`. Without a known
        world the robot drives too, but without these checks, figures and pictures. Raises ValueError for a scene that
        cannot be used.
        """
        return None

    def drive(self, command: Twist2D, time_ns: int) -> None:
        """Take a velocity between two calls of `advance`, at a run clock, ns; valid until the next one. Live only.

        A platform without it receives commands only in `advance`: then a stop waits for the next tick.
        """

    def close(self) -> None:
        """Close its ports. Live only: called once, after the last `drive`, when its process shuts down normally."""

    @abstractmethod
    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Drive with the command until the requested time, and report.

        Live, it must return well within the gate's `stop_deadline`: no other command reaches it meanwhile.
        """
