"""What every role shares: how a plugin is made, what it is told, and how it fails."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler

from navloom.errors import NavloomError
from navloom.geometry.world import World, read_only
from navloom.messages import Message, OccupancyGrid, Pose2D, RangeScan
from navloom.roles.claims import Claim

if TYPE_CHECKING:  # the default keeps `class Mine(Avoider)` valid under mypy --strict
    import typing_extensions

    P = typing_extensions.TypeVar("P", bound="Params", default=Any)
else:
    P = TypeVar("P")

__all__ = ["RESERVED_KEYS", "Context", "InputError", "Params", "RobotSpec", "Role", "SensorSpec", "StrictModel"]

RESERVED_KEYS = ("plugin", "name", "sensors", "inputs", "rate_hz", "latency", "diagnostics_rate_hz", "role", "shadow",
                 "required")  # fmt: skip
"""Keys of a role's table that the framework reads itself: no plugin can have a parameter of such a name."""


class InputError(NavloomError, ValueError):
    """A plugin was given data it cannot use: the text says what was given and what was expected."""


def _make_strict(schema: Any) -> None:
    """Mark the scalars of a core schema as strict, unless a field says otherwise."""
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
    """A model whose numbers, switches and texts are never converted: "7" is no number, 1 is not true.

    A whole number still passes as a real one. Lists pass as tuples and texts as paths, because TOML has neither.
    """

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> Any:
        schema = handler(source)
        _make_strict(schema)
        return schema


class Params(StrictModel):
    """Base of every plugin's parameters: unknown keys are refused, values cannot change after checking.

    Give each field bounds and, in its description, a unit. Angles are in degrees and their names end in `_deg`.
    Numbers, switches and texts are strict: "7" is no number.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True, eq=False)
class RobotSpec:
    """What every plugin is told about the robot.

    Attributes:
        footprint: (n, 2) corners of a convex polygon, counter-clockwise, m, base frame; read-only.
        height: m.
        wheel_radius, half_track: Nominal, m.
        max_linear, max_angular: Speed limits, m/s and rad/s.
        max_acceleration, max_deceleration: m/s².
        max_angular_acceleration: rad/s²; infinite where the robot has no limit.
        motor_lag: Time constant with which the wheels follow a command, s.
        dead_time: From a command to the wheels, s.
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "footprint", read_only(self.footprint))


@dataclass(frozen=True)
class SensorSpec:
    """One sensor of the config.

    Attributes:
        name: Also the name of the platform's port.
        kind: One of the platform's `sensor_kinds`.
        settings: The rest of its table, checked by the platform; read-only.
    """

    name: str
    kind: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "settings", MappingProxyType(dict(self.settings)))

    def __reduce__(self) -> tuple[Any, ...]:  # a mapping proxy has no copy of its own
        return SensorSpec, (self.name, self.kind, dict(self.settings))


@dataclass(frozen=True, eq=False)
class Context:
    """What the framework hands to a plugin when it makes it.

    Attributes:
        instance: Name of this instance.
        period: Control tick, s.
        robot: The robot.
        stream: Gives the random stream of a name; its seed comes from (run seed, role, instance, name). Asked again,
            the same stream continues.
        start: Where the robot starts, map frame.
        sensors: For a Platform: the sensors to provide.
        world: For a Platform: the ground truth, where there is one.
        map: For a Mapper or Localizer: the map the framework was given, where there is one.
        diagnostics_rate_hz: For an Avoider: how often its answers say why; infinite for each, 0 for none.
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


class Role(ABC, Generic[P]):
    """A plugin is a plain object: no thread, no clock, no socket, no file.

    Written with its parameters, as `class Gap(Avoider[GapParams])`, `self.params` has their type, and `Params` is set.

    Class attributes:
        role: Name of the role, set by the role's ABC.
        name: Name of the plugin, the one of its entry point.
        api: Major version of the role it is built for.
        is_patient: A step of the role may take long, since no motor waits for it; set by the role's ABC.
        accepts: Sensor messages its node is wired to, unless the config names `sensors`.
        needs_map: It cannot work without a map from the framework; `[map]` then defaults to the run's own world.
        needs_sensor: It cannot work without a sensor that it accepts: no robot is driven with it where there is none.
        is_bridge: It hands on what a system outside the robot says, as a ROS node: like a platform that is a driver, it
            may have threads and sockets.
        Params: Its parameters.
        claims: What it says of its behaviour beyond the purpose of its role: `navloom check` demands it.
        disclaims: What of its role's purpose it does not do, and why: `navloom check` shows it without judgement.
    """

    role: ClassVar[str]
    name: ClassVar[str]
    api: ClassVar[int] = 1
    is_patient: ClassVar[bool] = False
    accepts: ClassVar[tuple[type[Message], ...]] = (RangeScan,)
    needs_map: ClassVar[bool] = False
    needs_sensor: ClassVar[bool] = False
    is_bridge: ClassVar[bool] = False
    Params: ClassVar[type[Params]] = Params
    claims: ClassVar[Collection[Claim]] = ()
    disclaims: ClassVar[Mapping[Claim, str]] = MappingProxyType({})

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        given = [one for base in vars(cls).get("__orig_bases__", ()) for one in get_args(base)]
        models = [one for one in given if isinstance(one, type) and issubclass(one, Params)]
        if models and "Params" not in vars(cls):
            cls.Params = models[0]

    def __init__(self, params: P, context: Context) -> None:
        self.params = params
        self.context = context

    def reset(self) -> None:
        """Forget everything learnt since construction. A plugin without memory leaves it as it is.

        A run never calls it: every run, episode and restarted process makes a new object. `navloom check`, tests and
        scripts call it, to use one object for several trials.
        """

    def configure(self, params: P) -> None:
        """Take checked new parameters between two ticks. Forgets what was learnt, unless a plugin overrides it."""
        self.__init__(params, self.context)  # type: ignore[misc]

    @classmethod
    def warm_up(cls) -> None:
        """Compile what has to be compiled. Called once before the first tick; a plugin without kernels leaves it."""
