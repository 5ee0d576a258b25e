"""The tables of a config file. Tables of roles and sensors also hold plugin parameters, which are not checked here."""

from __future__ import annotations

import math
import re
from typing import Any, Literal, NamedTuple

from pydantic import Field, model_validator

from navloom.config.config_presets import split_preset
from navloom.config.table_parts import (
    Heading,
    HeadingSpread,
    OffsetTable,
    OpenTable,
    PlaceTable,
    PointTable,
    Positive,
    Start,
    StartTable,
    Table,
)
from navloom.inputs.spreads import sigma_of
from navloom.inputs.texts import INSTANCE
from navloom.roles import ROLES
from navloom.roles.base import DriveKind
from navloom.roles.presets import instance_name

__all__ = ["DEFAULT_PLUGINS", "AlternativeTable", "EventTable", "GOAL_TOLERANCE", "FootprintTable", "GateTable",
           "LONGEST_NAME", "LOOKING_TIMEOUT", "LiveTable", "MapTable", "NavigationTable", "NodeTable", "OWN_NODES",
           "OWN_PROCESS", "OffsetTable", "OpenTable", "PlaceTable", "PlacedTable", "PluginsTable", "PointTable",
           "REQUIRED_ROLES", "ROLE_TABLES", "RobotTable", "RoleTable", "RunTable", "STANDING_TIMEOUT", "SensorTable",
           "StartTable", "TAKEN", "Table", "WorldTable", "WORLD_NODE"]  # fmt: skip

ROLE_TABLES = ROLES.keys()
"""Roles; each has a table of its name in every config."""
REQUIRED_ROLES = tuple(role for role, cls in ROLES.items() if not cls.facts.is_optional)
"""Roles that every robot has; the others have a node only if the config has their table."""
OWN_NODES = ("goal", "reference", "gate")
WORLD_NODE = "world"
"""The node of a simulated robot in a world where something moves; it runs with the platform unless it is placed."""
TAKEN = (*ROLE_TABLES, *OWN_NODES, WORLD_NODE, "operator", "process")
"""Names that no [[node]] table can have, because the robot's keys use them."""
OWN_PROCESS = "nodes"
"""Process of the [[node]] tables that no process names, apart from those that drive the robot."""
GOAL_TOLERANCE = 0.2
"""How near to a goal the robot must come if neither the config nor the world says so, m."""
STANDING_TIMEOUT, LOOKING_TIMEOUT = 5.0, 120.0
"""Default of `navigation.localizer_timeout`, s, for a robot that stands, and for one that looks around meanwhile."""
LONGEST_NAME = 48
"""Longest name, in characters: a key has five names, and at most 255 bytes."""


class RunTable(Table):
    """One run."""

    # TOML's integers have 64 bits, with a sign.
    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of every random stream")
    period: float = Field(default=0.05, ge=0.001, le=1.0, description="length of a control tick, s")
    stop_after: float = Field(default=120.0, gt=0.0, le=1e6, description="longest run, s of robot time")


class FootprintTable(Table):
    """A rectangle or a disc centred on base, or a convex polygon."""

    length: Positive | None = Field(default=None, description="m, along x")
    width: Positive | None = Field(default=None, description="m, along y")
    radius: Positive | None = Field(default=None, description="m")
    polygon: list[tuple[float, float]] | None = Field(default=None, description="m, base frame, convex")

    @model_validator(mode="after")
    def _is_one_or_the_other(self) -> FootprintTable:
        # Half a rectangle beside another shape is refused too.
        shapes = {name for name in ("length", "width", "radius", "polygon") if getattr(self, name) is not None}
        if shapes not in ({"length", "width"}, {"radius"}, {"polygon"}):
            raise ValueError("expected either length and width, or radius, or polygon")
        return self


class RobotTable(Table):
    """Description of the robot for every plugin; the gate enforces the limits."""

    # Both names become parts of keys, where / * $ ? # have meanings.
    realm: str = Field(default="lab", max_length=LONGEST_NAME, pattern=r"^[A-Za-z0-9_-]+$")
    name: str = Field(default="r1", max_length=LONGEST_NAME, pattern=r"^[A-Za-z0-9_-]+$")
    footprint: FootprintTable = FootprintTable(length=0.8, width=0.8)
    height: Positive = Field(default=1.2, description="m")
    wheel_radius: Positive = Field(default=0.05, description="m")
    half_track: Positive = Field(default=0.30, description="m")
    max_linear: Positive = Field(default=0.5, description="m/s")
    max_angular_deg: Positive = Field(default=25.0, description="deg/s")
    max_acceleration: Positive = Field(default=0.5, description="m/s²")
    max_deceleration: Positive = Field(default=1.0, description="m/s²")
    # None, not infinity: the tables refuse infinity, since JSON has none.
    max_angular_acceleration_deg: Positive | None = Field(default=None, description="deg/s²; default: no limit")
    motor_lag: float = Field(default=0.0, ge=0.0, le=2.0, description="time constant of the wheels' speed, s")
    dead_time: float = Field(default=0.0, ge=0.0, le=2.0, description="from a command until it acts on the wheels, s")
    drive: DriveKind = Field(default="differential", description="how it moves")
    wheelbase: Positive | None = Field(default=None, description="ackermann: from the rear to the front axle, m")
    max_steering_deg: float | None = Field(
        default=None, ge=1.0, le=80.0, description="ackermann: largest angle of the middle of the front wheels, degrees"
    )
    max_steering_rate_deg: Positive | None = Field(default=None, description="ackermann: deg/s; default: no limit")

    @model_validator(mode="after")
    def _steers_if_ackermann(self) -> RobotTable:
        given = {name: getattr(self, name) for name in ("wheelbase", "max_steering_deg", "max_steering_rate_deg")}
        missing = [name for name in ("wheelbase", "max_steering_deg") if given[name] is None]
        if self.drive == "ackermann" and missing:
            raise ValueError(f'drive = "ackermann" needs {" and ".join(missing)}')
        surplus = [name for name, value in given.items() if value is not None]
        if self.drive != "ackermann" and surplus:
            raise ValueError(
                f'drive = "{self.drive}" has no steered wheels: expected no {" and no ".join(surplus)}, or '
                'drive = "ackermann"'
            )
        return self

    @property
    def max_angular(self) -> float:
        """Largest turn rate, rad/s."""
        return math.radians(self.max_angular_deg)

    @property
    def max_angular_acceleration(self) -> float:
        """Largest angular acceleration, rad/s²; infinite for no limit."""
        given = self.max_angular_acceleration_deg
        return math.inf if given is None else math.radians(given)


class WorldTable(Table):
    """The world of a simulated robot."""

    ref: str = Field(min_length=1, description="a name, a .toml file or scheme:argument")
    start: PlaceTable | None = Field(
        default=None, description="true start; default: navigation.start, else that of the world itself"
    )
    start_offset: OffsetTable = Field(default=OffsetTable(), description="added to the true start, map axes")


class MapTable(Table):
    """A map known before the run, for plugins that need one."""

    ref: str = Field(default="world", description='a world reference, or "world" for the world of the run')
    resolution: float = Field(default=0.05, ge=0.005, le=1.0, description="edge of a cell, m, without a raster")


class RoleTable(OpenTable):
    """A role's plugin; all other keys are its parameters."""

    plugin: str = Field(min_length=1, description="name of the plugin, or NAME@PRESET")
    preset: str | None = Field(default=None, min_length=1, description="set of its parameters; default: its defaults")
    name: str | None = Field(default=None, max_length=LONGEST_NAME, pattern=INSTANCE, description="of the instance")
    sensors: list[str] | None = Field(default=None, description="sensors that it reads; default: all that it supports")
    inputs: dict[str, str] | None = Field(
        default=None, description="stream of each input, as people.tracks; default: the only stream that fits"
    )
    rate_hz: Positive | None = Field(default=None, description="must divide the tick rate")
    latency: float = Field(default=0.0, ge=0.0, le=60.0, description="delay of its outputs in lockstep, s")
    diagnostics_rate_hz: float | None = Field(
        default=None, ge=0.0, description="avoider: rate of its diagnostics; default 2; 0: none"
    )

    @model_validator(mode="before")
    @classmethod
    def _has_one_preset(cls, given: Any) -> Any:
        return split_preset(given) if isinstance(given, dict) else given

    @property
    def instance(self) -> str:
        """Name of the instance: `name`, or the plugin's name with its preset."""
        return self.name or instance_name(self.plugin, self.preset)


class NodeTable(RoleTable):
    """A node plugin."""

    name: str = Field(
        max_length=LONGEST_NAME, pattern=r"^[a-z][A-Za-z0-9_]*$", description="name of the node, used like a role's"
    )
    required: bool = Field(default=False, description="the gate stops the robot when the node is gone")

    @property
    def instance(self) -> str:
        """Name of the instance: the plugin's name with its preset, since `name` is the node's."""
        return instance_name(self.plugin, self.preset)


class AlternativeTable(RoleTable):
    """Another instance of a role or node, which runs as a shadow or waits to be swapped in."""

    role: str = Field(min_length=1, description="a role, or the name of a [[node]]")
    shadow: bool = True


class PlacedTable(NamedTuple):
    """The table of an instance, with its place in the file and its role or node."""

    place: str
    role: str
    table: RoleTable


class SensorTable(OpenTable):
    """One sensor; all other keys are its settings."""

    name: str = Field(max_length=LONGEST_NAME, pattern=r"^[a-z][A-Za-z0-9_]*$")
    kind: str = Field(min_length=1)
    # Above 0 by no more than mappers extrapolate the track of the robot.
    time_offset: float = Field(
        default=0.0, ge=-1.0, le=0.2, description="added to its stamps, s; of scans stamped 0.12 s late: -0.12"
    )


class NavigationTable(Table):
    """Start, goal, and the settings of the framework's own nodes."""

    start: Start | None = Field(default=None, description='its pose, a guess, or "unknown"; default: the world\'s')
    goal: PlaceTable | None = Field(default=None, description='default: the world\'s; see "drive"')
    via: list[PointTable] = Field(default_factory=list, description="points to pass, in order")
    drive: bool = Field(default=True, description="drive to the goal at once; false waits for goals")
    goal_tolerance: Positive | None = Field(
        default=None, description=f"m; default: the world's, else {GOAL_TOLERANCE:g}"
    )
    heading_tolerance_deg: Positive = Field(default=5.0, description="if the goal has a heading")
    speed: tuple[Positive, Positive] | None = Field(None, description="limits, m/s; default: 0.4, 0.8 max_linear")
    lateral_acceleration: Positive | None = Field(None, description="in curves, m/s²; default: 0.6 max_acceleration")
    path_shape: Literal["rounded", "as_planned"] = Field(
        default="rounded", description="prune and round the planner's path, or drive along its own points"
    )
    look_ahead: Positive = Field(default=1.2, description="m, from the robot to the avoider's target")
    corridor_margin: float = Field(default=0.04, ge=0.0, description="added to the robot's half width, m")
    handover: Literal["when_blocked", "always", "never"] = "when_blocked"
    handover_own_way: bool = Field(default=True, description="also check the way that the robot itself takes next")
    handover_release: float = Field(default=0.5, ge=0.0, description="time the corridor must be free to hand back, s")
    stuck_after: Positive = Field(default=15.0, description="time without progress, s")
    max_recoveries: int = Field(default=3, ge=0)
    patience: float = Field(
        default=0.0, ge=0.0, description="how long a goal without a way, after its recoveries, waits and plans again, s"
    )
    map_timeout: Positive = Field(default=10.0, description="longest wait for a map, s")
    localizer_timeout: Positive | None = Field(
        default=None,
        description=f"longest wait for a localizer that is not tracking, s; default: {STANDING_TIMEOUT:g}, and "
        f"{LOOKING_TIMEOUT:g} if the robot looks around meanwhile",
    )
    plan_timeout: Positive = Field(default=10.0, description="longest wait for a plan, s")
    replan_when_blocked: bool = Field(default=True, description="plan again when a new map blocks the trajectory")
    replan_period: float = Field(default=0.0, ge=0.0, description="interval of plans while driving, s; 0: none")
    replan_gain: float = Field(
        default=0.1, ge=0.0, lt=1.0, description="share by which such a plan must be shorter to be driven"
    )

    def speeds(self, max_linear: float) -> tuple[float, float]:
        """Limits of the reference, m/s: as given, or shares that leave the controller some speed to catch up."""
        return self.speed or (0.4 * max_linear, 0.8 * max_linear)

    def sideways(self, max_acceleration: float) -> float:
        """Lateral acceleration of the reference, m/s²: as given, or a share of the robot's acceleration."""
        return self.lateral_acceleration or 0.6 * max_acceleration

    @model_validator(mode="after")
    def _speeds_rise(self) -> NavigationTable:
        if self.speed is not None and self.speed[0] > self.speed[1]:
            raise ValueError(f"speed is [{self.speed[0]:g}, {self.speed[1]:g}], expected the lower one first")
        return self


class GateTable(Table):
    """When the command gate stops the robot."""

    stop_deadline: Positive = Field(default=0.10, description="longest lag of a command behind the platform, s")
    sensor_timeout: Positive = Field(default=0.5, description="longest silence of a required sensor, s")
    monitor: bool = Field(default=True, description="check commands against the range sensors")
    range_sigma: Positive = Field(default=0.03, description="standard deviation of a range that the monitor reads, m")
    approach_speed: float = Field(
        default=2.0,
        ge=0.0,
        le=5.0,
        description="highest speed of obstacles that the monitor allows for, m/s; 0: all at rest",
    )


_OPTIONAL_KEYS = {
    "goal": ("heading_deg",), "set": ("name", "values"), "place": ("spread", "heading_spread_deg"),
    "displace": ("over",), "slip": ("by", "over"), "actor": ("name",),
}  # fmt: skip
"""Keys that an event may have beside those that it needs, by what it does."""


class EventTable(Table):
    """An operator's action at a given time, or what happens to a simulated robot then."""

    at: float = Field(ge=0.0, description="s after the first tick")
    do: Literal["swap", "goal", "cancel", "set", "stop", "resume", "place", "relocalise", "displace", "slip", "actor"]
    x: float | None = None
    y: float | None = None
    heading_deg: Heading | None = None
    spread: Positive | None = Field(default=None, description="for place: as that of navigation.start")
    heading_spread_deg: HeadingSpread | None = Field(default=None, description="for place: as for navigation.start")
    role: str | None = None
    name: str | None = Field(default=None, description="instance, for swap and set; of an actor")
    values: dict[str, Any] = Field(
        default_factory=dict, description="for set: the parameters to change; for actor: its table"
    )
    by: OffsetTable | None = Field(default=None, description="for displace and slip: a motion, in the robot's frame")
    over: float = Field(default=0.0, ge=0.0, description="for displace and slip: s that it takes; 0: one tick")

    @model_validator(mode="after")
    def _has_what_it_needs(self) -> EventTable:
        needed = {
            "swap": ("role", "name"), "goal": ("x", "y"), "set": ("role",), "place": ("x", "y", "heading_deg"),
            "displace": ("by",) if self.by else ("x", "y", "heading_deg"),
            "actor": ("values",),
        }.get(self.do, ())  # fmt: skip
        missing = [key for key in needed if getattr(self, key) is None]
        if self.do in ("set", "actor") and not self.values:
            missing.append("values")
        if self.do == "slip" and self.by is None and not self.over:
            missing.append("over or by")
        if missing:
            raise ValueError(f'do = "{self.do}" also needs {" and ".join(missing)}')
        allowed = {"at", "do", *needed, *_OPTIONAL_KEYS.get(self.do, ())}
        extra = sorted(self.model_fields_set - allowed)
        if extra:
            raise ValueError(f'do = "{self.do}" has no use for {" and ".join(extra)}')
        return self

    @property
    def sigma(self) -> tuple[float, float] | None:
        """For place: standard deviations, m and rad; None for an exact pose."""
        return sigma_of(self.spread, self.heading_spread_deg)


DEFAULT_PLUGINS = {role: cls.facts.default_plugin for role, cls in ROLES.items() if cls.facts.default_plugin}
"""Default plugin of each role that has one."""


def _default_processes() -> dict[str, list[str]]:
    """The processes of every robot, without optional roles."""

    def of(process: str) -> list[str]:
        return [role for role in REQUIRED_ROLES if ROLES[role].facts.process == process]

    return {
        "robot": of("robot"),
        "think": [*of("think"), "goal"],
        "drive": ["reference", *of("drive")],
        "safe": ["gate"],
    }


class LiveTable(Table):
    """How `up` and `node` distribute nodes over processes and hosts; lockstep ignores it."""

    processes: dict[str, list[str]] = Field(default_factory=_default_processes)
    hosts: dict[str, list[str]] = Field(default_factory=dict, description="processes of each host")
    router: str | None = Field(default=None, description="endpoint of the robot's router, as tls/10.0.0.1:7447")
    router_host: str | None = Field(default=None, description="host that starts the router; default: start it by hand")
    keys: str | None = Field(default=None, description="folder of certificates, see `navloom keys`")
    shared_memory: bool = Field(default=False, description="messages of 3 KB and more pass through it on one host")
    hang_timeout: Positive = Field(default=2.0, description="longest step before its process is killed, s")
    restart_limit: int = Field(default=5, ge=0, description="crashes within restart_window before it stays down")
    restart_window: Positive = Field(default=30.0, description="s")
    keep_pose: bool | None = Field(
        default=None, description="`up` begins where the robot was when it was last up; default: if it is a real robot"
    )

    @model_validator(mode="after")
    def _spread_fits(self) -> LiveTable:
        placed: dict[str, str] = {}
        for process, nodes in self.processes.items():
            if not re.fullmatch(r"[A-Za-z0-9_-]+", process):
                raise ValueError(f'process "{process}": expected letters, digits, _ and -')
            for node in nodes:
                if node in placed:
                    raise ValueError(f'"{node}" is in the processes {placed[node]} and {process}')
                placed[node] = process
        missing = [role for role in (*REQUIRED_ROLES, *OWN_NODES) if role not in placed]
        if missing:
            raise ValueError(f"processes leave out {', '.join(missing)}")
        for host, processes in self.hosts.items():
            for process in processes:
                if process not in self.processes:
                    raise ValueError(f'host {host} names "{process}"; processes are {", ".join(self.processes)}')
        return self

    @model_validator(mode="after")
    def _hosts_fit(self) -> LiveTable:
        placed: dict[str, str] = {}
        for host, processes in self.hosts.items():
            for process in processes:
                if process in placed:
                    raise ValueError(f'"{process}" is on the hosts {placed[process]} and {host}')
                placed[process] = host
        if len(set(placed.values())) > 1 and not self.router:
            raise ValueError('hosts reach each other through a router: give router, as in router = "tls/10.0.0.1:7447"')
        if self.router_host is not None and (not self.router or self.router_host not in self.hosts):
            known = f"hosts are {', '.join(self.hosts)}" if self.hosts else "there are no hosts"
            raise ValueError(f'router_host is "{self.router_host}"; {known if self.router else "router is missing"}')
        return self


class PluginsTable(Table):
    """Which plugins may be used."""

    blocked: list[str] = Field(default_factory=list, description="role.name, treated as not installed")
