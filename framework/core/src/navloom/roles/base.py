"""Common base of all roles: construction, parameters, context and errors of a plugin."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler

from navloom.errors import NavloomError
from navloom.geometry.world import World, read_only
from navloom.messages import Message, OccupancyGrid, Pose2D, RangeScan
from navloom.roles.claims import Claim
from navloom.roles.disturbances import Disturbance
from navloom.roles.facts import RoleFacts
from navloom.roles.presets import Preset

if TYPE_CHECKING:  # the default keeps `class Mine(Avoider)` valid under mypy --strict
    import typing_extensions

    P = typing_extensions.TypeVar("P", bound="Params", default=Any)
else:
    P = TypeVar("P")

__all__ = [
    "ANYWHERE",
    "RESERVED_KEYS",
    "Context",
    "DriveKind",
    "InputError",
    "Params",
    "RobotSpec",
    "Role",
    "SensorSpec",
    "StrictModel",
]

RESERVED_KEYS = ("plugin", "preset", "name", "sensors", "inputs", "rate_hz", "latency", "diagnostics_rate_hz", "role",
                 "shadow", "required")  # fmt: skip
"""Keys of a role's table that the framework reads itself; no plugin can have a parameter of such a name."""


class InputError(NavloomError, ValueError):
    """A plugin received data that it cannot use. The text says what was given and what was expected."""


def _make_strict(schema: Any) -> None:
    """Make the scalars of a core schema strict, unless a field says otherwise."""
    if isinstance(schema, dict):
        if schema.get("type") in ("int", "float", "bool", "str"):
            schema.setdefault("strict", True)
        for key, inner in schema.items():
            if key not in ("default", "expected", "metadata", "serialization"):
                _make_strict(inner)
    elif isinstance(schema, list):
        for inner in schema:
            _make_strict(inner)


class StrictModel(BaseModel):
    """A model whose numbers, booleans and strings are never converted: "7" is no number, 1 is not true.

    An integer is still accepted as a float, a list as a tuple, and a string as a path, because TOML has neither tuples
    nor paths.
    """

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> Any:
        schema = handler(source)
        _make_strict(schema)
        return schema


class Params(StrictModel):
    """Base of every plugin's parameters: unknown keys are refused, and checked values cannot change.

    Give each field bounds, and a unit in its description. Angles are in degrees, and their names end in `_deg`.
    Numbers, booleans and strings are strict: "7" is no number.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


DriveKind = Literal["differential", "ackermann", "holonomic"]


@dataclass(frozen=True, eq=False)
class RobotSpec:
    """Description of the robot for every plugin.

    Attributes:
        footprint: (n, 2) corners of a convex polygon, counter-clockwise, m, base frame; read-only.
        height: Height of the robot, m.
        wheel_radius, half_track: Nominal values, m.
        max_linear, max_angular: Speed limits, m/s and rad/s.
        max_acceleration, max_deceleration: m/s².
        max_angular_acceleration: rad/s²; infinite for no limit.
        motor_lag: Time constant with which the wheels follow a command, s.
        dead_time: Time from a command until it acts on the wheels, s.
        drive: How it moves: "differential", with two driven wheels; "ackermann", with steered front wheels, the base's
            origin midway between the rear wheels; "holonomic", in any direction.
        wheelbase: Distance between the axles of an Ackermann robot, m; otherwise 0.
        max_steering, max_steering_rate: Its largest steering angle, rad, and rate, rad/s; 0 and infinite otherwise.
    """

    footprint: NDArray[np.float64]
    height: float
    wheel_radius: float
    half_track: float
    max_linear: float
    max_angular: float
    max_acceleration: float
    max_deceleration: float
    max_angular_acceleration: float = math.inf
    motor_lag: float = 0.0
    dead_time: float = 0.0
    drive: DriveKind = "differential"
    wheelbase: float = 0.0
    max_steering: float = 0.0
    max_steering_rate: float = math.inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "footprint", read_only(self.footprint))

    @property
    def turn_radius(self) -> float:
        """Smallest radius, m, on which the base's origin can drive; 0 for a robot that can turn in place."""
        return self.wheelbase / math.tan(self.max_steering) if self.drive == "ackermann" else 0.0


@dataclass(frozen=True)
class SensorSpec:
    """One sensor of the config.

    Attributes:
        name: Name of the sensor and of the platform's port.
        kind: One of the platform's `sensor_kinds`.
        settings: The other keys of its table, checked by the platform; read-only.
    """

    name: str
    kind: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "settings", MappingProxyType(dict(self.settings)))

    def __reduce__(self) -> tuple[Any, ...]:  # a mapping proxy cannot be copied or pickled
        return SensorSpec, (self.name, self.kind, dict(self.settings))


ANYWHERE = (math.inf, math.inf)
"""Standard deviations, m and rad, of a place that is not known at all."""


@dataclass(frozen=True, eq=False)
class Context:
    """What a plugin receives from the framework at its construction.

    Attributes:
        instance: Name of this instance.
        period: Control tick, s.
        robot: The robot.
        stream: Returns the random stream of a name, seeded from (run seed, role, instance, name). A second call
            returns the same stream, continued.
        start: Start pose, map frame.
        start_sigma: For a Localizer: standard deviations of the start, of x and of y, m, and of the heading, rad, if
            it is a guess; `ANYWHERE` if it is not known, and then `start` says nothing; None for a start that is known.
        sensors: For a Platform: the sensors to provide.
        world: For a Platform: the ground truth, or None; what moves there comes with each `PlatformInput`.
        disturbances: For a Platform that `takes_disturbances`: what happens to it from outside, by their beginning.
        map: For a Mapper or Localizer: the known map, or None.
        diagnostics_rate_hz: For an Avoider: rate of its diagnostics; infinite for every answer, 0 for none.
    """

    instance: str
    period: float
    robot: RobotSpec
    stream: Callable[[str], np.random.Generator]
    start: Pose2D
    sensors: tuple[SensorSpec, ...] = ()
    world: World | None = None
    map: OccupancyGrid | None = None
    diagnostics_rate_hz: float = math.inf
    start_sigma: tuple[float, float] | None = None
    disturbances: tuple[Disturbance, ...] = ()


class Role(ABC, Generic[P]):
    """Base of all plugins. A plugin is a plain object: no thread, no clock, no socket, no file.

    Declare its parameters as in `class Gap(Avoider[GapParams])`: then `self.params` has this type, and `Params` is set.

    Class attributes:
        role: Name of the role, set by the role's ABC.
        facts: What is true of every plugin of the role, set by the role's ABC.
        name: Name of the plugin, as in its entry point.
        api: Major version of the role that it is built for.
        is_patient: A step of the role may take long because no motor waits for it, if it releases the GIL; set by the
            role's ABC.
        accepts: Message classes of the sensors that it reads, unless the config names `sensors`.
        needs_map: It cannot work without a known map; `[map]` then defaults to the run's world.
        needs_sensor: It cannot work without a sensor that it accepts; a robot without one is refused.
        is_bridge: It passes on messages of a system outside the robot, such as a ROS node. Like a platform that is a
            driver, it may have threads and sockets.
        Params: Class of its parameters.
        presets: Named sets of its parameters. One without settings is the name of the defaults.
        claims: Claims beyond the purpose of its role; `navloom check` requires them.
        disclaims: Claims of its role's purpose that it does not meet, each with the reason; `navloom check` shows them
            without judging them.
    """

    role: ClassVar[str]
    facts: ClassVar[RoleFacts]
    name: ClassVar[str]
    api: ClassVar[int] = 1
    is_patient: ClassVar[bool] = False
    accepts: ClassVar[tuple[type[Message], ...]] = (RangeScan,)
    needs_map: ClassVar[bool] = False
    needs_sensor: ClassVar[bool] = False
    is_bridge: ClassVar[bool] = False
    Params: ClassVar[type[Params]] = Params
    presets: ClassVar[Mapping[str, Preset]] = MappingProxyType({})
    claims: ClassVar[Collection[Claim]] = ()
    disclaims: ClassVar[Mapping[Claim, str]] = MappingProxyType({})

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        given = [argument for base in vars(cls).get("__orig_bases__", ()) for argument in get_args(base)]
        models = [argument for argument in given if isinstance(argument, type) and issubclass(argument, Params)]
        if models and "Params" not in vars(cls):
            cls.Params = models[0]

    def __init__(self, params: P, context: Context) -> None:
        self.params = params
        self.context = context

    def reset(self) -> None:
        """Forget everything learned since construction. Override it if the plugin has memory.

        A run never calls it: every run, episode and restarted process makes a new object. `navloom check`, tests and
        scripts call it, to use one object for several trials.
        """

    def configure(self, params: P) -> None:
        """Take new, checked parameters between two ticks. The default forgets what was learned."""
        self.__init__(params, self.context)  # type: ignore[misc]

    @classmethod
    def warm_up(cls) -> None:
        """Compile kernels. Called once before the first tick; override it if the plugin has kernels."""
