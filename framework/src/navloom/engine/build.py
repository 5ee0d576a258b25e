"""From a checked config to plugins, nodes and slots, ready to step."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from pydantic import ValidationError

from navloom.config import ConfigError, Loaded, check_params
from navloom.config.problems import Gathered, problems_of
from navloom.config.schema import Config, EventTable, PlaceTable, RoleTable
from navloom.engine.catalogue import Catalogue, role_node
from navloom.engine.parts import Part, catalogue_of_parts, connect, find_parts, find_streams, sensors_of
from navloom.engine.ports import NodeSpec, Port
from navloom.engine.random_streams import stream_source
from navloom.engine.stepper import fault_text
from navloom.engine.streams import sensor_port
from navloom.geometry.footprints import FootprintError, polygon, rectangle
from navloom.geometry.world import World
from navloom.inputs.texts import toml_of
from navloom.messages import OccupancyGrid, Pose2D, RangeScan
from navloom.messages.packing import writer_of
from navloom.messages.typed import typed_reader
from navloom.navigation import blocking, handover, monitor, projection, trajectory
from navloom.navigation.handover import HandOverRule
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import nearest
from navloom.roles import ROLES, Context, Platform, RobotSpec, Role, SensorSpec

__all__ = ["System", "assemble", "make_plugins", "robot_spec", "try_plugins"]

Progress = Callable[[str], None]
YOUNG_OBJECTS = 10_000
"""Objects made between two looks of the garbage collector at the newest; Python's default, 700, is a dozen ticks."""
DIAGNOSTICS_RATE_HZ = 2.0
"""How often an avoider says why, unless its table says otherwise, Hz."""


@dataclass(eq=False)
class System:
    """Everything of a run but the executor.

    Attributes:
        loaded: The config.
        robot: What plugins are told.
        world: Ground truth, or None on a real robot.
        start: Pose in the map.
        goal: Where to go, or None.
        goal_tolerance: m.
        catalogue: Its nodes, and what is known of their streams.
        specs: Nodes in the order they step, each with the inputs of all its instances.
        wiring: Of each instance, by role and name.
        parts: By (role, instance): active ones first.
        sensors: As configured.
        scans_on_request: The active mapper lives on sweeps that must be asked for.
        absent: Of a replay: active instances by name of nodes that the robot had and that are not installed here.
    """

    loaded: Loaded
    robot: RobotSpec
    world: World | None
    start: Pose2D
    goal: PlaceTable | None
    goal_tolerance: float
    catalogue: Catalogue
    specs: list[NodeSpec]
    wiring: dict[tuple[str, str], NodeSpec]
    parts: dict[tuple[str, str], Part]
    sensors: tuple[SensorSpec, ...]
    scans_on_request: bool
    map: OccupancyGrid | None = field(default=None)
    absent: Mapping[str, str] = field(default_factory=dict)

    @property
    def time_limit(self) -> float:
        """Run time at which a run ends, s: the config's, or the world's where that is shorter."""
        authored = self.world.time_limit if self.world is not None else None
        stop_after = self.config.run.stop_after
        return stop_after if authored is None else min(stop_after, authored)

    @property
    def true_start(self) -> Pose2D:
        """Where a simulated robot really starts, map frame; `start` is what it believes."""
        table, start = self.config.world, self.start
        if table is None:
            return start
        offset = table.start_offset
        heading = math.remainder(start.heading + math.radians(offset.heading_deg), math.tau)
        return Pose2D(start.x + offset.x, start.y + offset.y, heading)

    @property
    def config(self) -> Config:
        """What holds."""
        return self.loaded.config

    @property
    def may_wait(self) -> list[tuple[str, str]]:
        """Instances of roles, stepped before the gate, that may have to wait for the first message of an input."""
        order = [spec.role for spec in self.specs]
        return [
            (role, name)
            for role in order[: order.index("gate")]
            for owner, name in self.parts
            if owner == role in ROLES and any(given.is_needed for given in self.wiring[role, name].inputs)
        ]

    def plugin(self, role: str, instance: str) -> Role:
        """The object behind an instance."""
        plugin = self.parts[(role, instance)].plugin
        assert plugin is not None
        return plugin


def robot_spec(config: Config) -> RobotSpec:
    """What plugins are told about the robot. Raises ConfigError for a footprint no robot can have."""
    table = config.robot
    shape = table.footprint
    try:
        if shape.polygon is not None:
            outline = polygon(shape.polygon)
        else:
            assert shape.length is not None and shape.width is not None
            outline = rectangle(shape.length, shape.width)
    except FootprintError as error:
        raise ConfigError(f"robot.footprint: {error}") from None
    return RobotSpec(
        outline,
        table.height,
        table.wheel_radius,
        table.half_track,
        table.max_linear,
        table.max_angular,
        table.max_acceleration,
        table.max_deceleration,
        table.max_angular_acceleration,
        table.motor_lag,
        table.dead_time,
    )


def assemble(loaded: Loaded, discovery: Discovery | None = None) -> System:
    """Find the plugins, check their parameters and the wiring. Makes no plugin yet.

    Raises:
        ConfigError: Something in the file does not fit, each on a line; PluginError: a plugin cannot be used.
    """
    config, problems = loaded.config, Gathered()
    discovery = discovery or Discovery(config.plugins.blocked)
    parts, world, robot = find_parts(config, discovery, problems), None, None
    catalogue = catalogue_of_parts(config, parts, problems)
    platform_part = parts.get(("platform", config.platform.instance))
    with problems.gather():
        world = _world(loaded, discovery, platform_part)
    with problems.gather():
        robot = robot_spec(config)
    sensors = _sensors(config, platform_part.cls, problems) if platform_part is not None else ()
    for place, role, table in config.role_tables():
        with problems.gather():
            _stride(table, config.run.period, place)
            _explains(table, place, role)
    ports: dict[str, Port[Any]] = {}
    if platform_part is not None and len(sensors) == len(config.sensor):
        assert issubclass(platform_part.cls, Platform)
        ports = {one.name: sensor_port(one.name, platform_part.cls.sensor_kinds[one.kind]) for one in sensors}
        for part in parts.values():
            with problems.gather():
                part.sensors = sensors_of(part, platform_part.cls, sensors)
    if len(parts) == len(config.role_tables()):
        for part in parts.values():
            with problems.gather():
                part.streams = find_streams(part, [*catalogue.ports(), *ports.values()])
    problems.refuse(loaded.error)
    assert robot is not None and platform_part is not None
    with problems.gather():
        system = _system(loaded, robot, world, parts, sensors, catalogue, ports)
    problems.refuse(loaded.error)
    with problems.gather():
        if config.map is not None or any(part.cls.needs_map for part in parts.values()):
            system.map = _known_map(loaded, discovery, world)
    _check_set_events(system, problems)
    problems.refuse(loaded.error)
    return system


def _system(
    loaded: Loaded,
    robot: RobotSpec,
    world: World | None,
    parts: dict[tuple[str, str], Part],
    sensors: tuple[SensorSpec, ...],
    catalogue: Catalogue,
    ports: Mapping[str, Port[Any]],
) -> System:
    """A system of parts that fit."""
    config = loaded.config
    platform = parts[("platform", config.platform.instance)].cls
    assert issubclass(platform, Platform)
    ranging = [name for name, port in ports.items() if issubclass(port.carries, RangeScan)]
    specs, wiring = connect(catalogue, parts, ports, ranging if config.gate.monitor else ())
    start, goal, tolerance = _task(config, world)
    mapper = set(parts[("mapper", config.mapper.instance)].sensors)
    asks = any(sensor.name in mapper and platform.scans_on_request(sensor) for sensor in sensors)
    return System(loaded, robot, world, start, goal, tolerance, catalogue, specs, wiring, parts, sensors, asks)


def make_plugins(
    system: System, progress: Progress = lambda text: None, only: Collection[tuple[str, str]] | None = None
) -> None:
    """Make every plugin, or those of some instances, and compile their kernels, so that no tick does.

    Raises:
        ConfigError: A plugin refuses its world, sensors or map.
    """
    progress("preparing the framework")
    for warm_up in (blocking.warm_up, handover.warm_up, monitor.warm_up, trajectory.warm_up, projection.warm_up):
        warm_up()
    for spec in system.specs:
        for port in spec.ports:
            writer_of(port.carries)
            if only is not None:  # not all run in this process: messages come as bytes
                typed_reader(port.carries)
    warmed: set[type[Role]] = set()
    for (role, instance), part in system.parts.items():
        if only is not None and (role, instance) not in only:
            continue
        if part.cls not in warmed:
            progress(f"preparing {role} {part.cls.name}")
            with _blamed(part, "warm_up"):
                part.cls.warm_up()
            warmed.add(part.cls)
        part.plugin = _made(system, part)
    _spare_what_is_loaded()


@cache
def _spare_what_is_loaded() -> None:
    """Have the garbage collector pass over the libraries from now on: a look at all of them takes a tick or two.

    It also looks at new objects less often than by default: messages hold no cycles, so it finds next to nothing.
    """
    gc.freeze()
    gc.set_threshold(YOUNG_OBJECTS)


def try_plugins(system: System) -> None:
    """Make every plugin once and keep none, without compiling: for what only a plugin itself can refuse.

    A real platform is left out, since it would take the robot's ports.

    Raises:
        ConfigError, PluginError: One line a plugin that cannot be made.
    """
    problems = Gathered()
    for part in system.parts.values():
        if part.role != "platform" or getattr(part.cls, "is_simulated", False):
            with problems.gather():
                _made(system, part)
    problems.refuse(system.loaded.error)


def _made(system: System, part: Part) -> Role:
    """A new plugin, which takes the parameters of events too."""
    config, role, instance = system.config, part.role, part.table.instance
    context = Context(
        instance=instance,
        period=config.run.period,
        robot=system.robot,
        stream=stream_source(config.run.seed, role, instance),
        start=system.true_start if role == "platform" else system.start,
        sensors=system.sensors if role == "platform" else (),
        world=system.world if role == "platform" else None,
        map=system.map if role in ("mapper", "localizer") else None,
        diagnostics_rate_hz=DIAGNOSTICS_RATE_HZ if (rate := part.table.diagnostics_rate_hz) is None else rate,
    )
    with _blamed(part, "__init__"):
        plugin = part.cls(part.params, context)
    if role != "platform":  # a second one might take the robot's ports from the first
        _try_set_events(system, part, context)
    return plugin


def _try_set_events(system: System, part: Part, context: Context) -> None:
    """Refuse parameter changes that the plugin will not take when their time comes."""
    values: dict[str, Any] = part.params.model_dump(exclude_unset=True)
    for number, event, source in sorted(_set_events(system.config), key=lambda entry: entry[1].at):
        if source == (part.role, part.table.instance):
            values |= event.values
            with _blamed_on_event(number), _blamed(part, "configure"):
                stream = stream_source(system.config.run.seed, *source)
                part.cls(check_params(part.cls.Params, values, part.place), replace(context, stream=stream))


@contextmanager
def _blamed(part: Part, verb: str) -> Iterator[None]:
    """Say whose fault it is where a plugin cannot be made: the config's, which it refuses, or its own."""
    try:
        yield
    except ValidationError as error:
        raise ConfigError(*problems_of(error, part.cls.Params, part.place)) from None
    except ValueError as error:
        raise ConfigError(f"{part.place} ({part.cls.name}): {error}") from None
    except (Exception, SystemExit) as error:
        text = fault_text(error, part.cls)
        raise PluginError(f"{part.place}.plugin: {part.cls.name} fails in {verb}: {text}") from None


def role_nodes(system: System, only: Collection[tuple[str, str]] | None = None) -> dict[tuple[str, str], Any]:
    """A node for each plugin, or for those of some instances."""
    rules = system.config.navigation
    nodes = {}
    for key in system.parts if only is None else [key for key in system.parts if key in only]:
        rule = None
        if key[0] == "avoider":
            rule = HandOverRule(rules.handover, rules.handover_release, margin=rules.corridor_margin)
        look_ahead = rules.look_ahead if rules.handover_own_way else 0.0
        nodes[key] = role_node(system.plugin(*key), rule, look_ahead, system.goal_tolerance)
    return nodes


def changed_params(system: System, role: str, instance: str, assignments: tuple[str, ...]) -> Any:
    """An instance's parameters with some changed. Raises ConfigError that names the one that does not fit."""
    part = system.parts[(role, instance)]
    current = part.params if part.plugin is None else part.plugin.params
    values = {**current.model_dump(exclude_unset=True), **toml_of("\n".join(assignments), "parameters", ConfigError)}
    return check_params(part.cls.Params, values, role if part.place == role else f"{role}.{instance}")


def configure(system: System, role: str, instance: str, assignments: tuple[str, ...]) -> None:
    """Change some of an instance's parameters, all or none: a plugin that refuses them is as it was before.

    Raises:
        ConfigError: They do not fit, or not together; PluginError: the plugin breaks at them.
    """
    params = changed_params(system, role, instance, assignments)
    plugin = system.plugin(role, instance)
    before = dict(vars(plugin))
    try:
        with _blamed(system.parts[(role, instance)], "configure"):
            plugin.configure(params)
    except BaseException:
        vars(plugin).clear()
        vars(plugin).update(before)
        raise


def stride_of(table: RoleTable, period: float) -> int:
    """Ticks between steps of a node."""
    return 1 if table.rate_hz is None else round(1.0 / (table.rate_hz * period))


def _world(loaded: Loaded, discovery: Discovery, platform: Part | None) -> World | None:
    """The true world: that of the config, or the one that the platform brings along."""
    own = None if platform is None else _own_world(platform)
    if loaded.config.world is None:
        return own
    if own is not None:
        raise ConfigError(
            f"world.ref: is {loaded.config.world.ref!r}, but the platform {loaded.config.platform.plugin} brings a "
            "world of its own: leave [world] and --worlds out"
        )
    return _resolve(loaded, discovery, "world.ref", loaded.config.world.ref)


def own_world(loaded: Loaded, discovery: Discovery) -> World | None:
    """The world that the platform of a config brings along; None where it brings none, or cannot tell.

    Raises:
        ConfigError, PluginError: The platform is not known, or refuses its parameters or its scene.
    """
    problems = Gathered()
    parts = find_parts(loaded.config, discovery, problems)
    problems.refuse(loaded.error)
    return _own_world(parts["platform", loaded.config.platform.instance])


def _own_world(part: Part) -> World | None:
    assert issubclass(part.cls, Platform)
    with _blamed(part, "own_world"):
        world: World | None = part.cls.own_world(part.params)
        if world is not None and not isinstance(world, World):
            raise TypeError(f"it gives {type(world).__name__}, expected World or None")
    return world


def _resolve(loaded: Loaded, discovery: Discovery, place: str, reference: str) -> World:
    try:
        return discovery.world(reference, loaded.base_of(place))
    except (PluginError, ValueError) as error:
        raise ConfigError(f"{place}: {error}") from None


def _known_map(loaded: Loaded, discovery: Discovery, world: World | None) -> OccupancyGrid:
    table = loaded.config.map
    reference = table.ref if table is not None else "world"
    resolution = table.resolution if table is not None else 0.05
    if reference != "world":
        world = _resolve(loaded, discovery, "map.ref", reference)
    if world is None:
        raise ConfigError(
            'map.ref: is "world", but there is no [world], and the platform tells none; name a map, as in '
            'ref = "rosmap:F.yaml"'
        )
    return grid_of(world, resolution, loaded.config.robot.height)


def grid_of(world: World, resolution: float, height: float) -> OccupancyGrid:
    """A world as a map: its raster as it is where that is all there is, else drawn in cells of a resolution, m."""
    from navloom.geometry.grid import world_to_grid

    raster = world.raster
    if raster is not None and not world.obstacles:
        cells = np.where(raster.occupied, 100, 0).astype(np.int8)
        return OccupancyGrid(cells, raster.resolution, Pose2D(raster.origin.x, raster.origin.y, raster.origin.heading))
    grid = world_to_grid(world, resolution, (0.0, height))
    return OccupancyGrid(grid.cells, grid.resolution, Pose2D(grid.origin.x, grid.origin.y, grid.origin.heading))


def _sensors(config: Config, platform: type[Role], problems: Gathered) -> tuple[SensorSpec, ...]:
    """The sensors that the platform can give."""
    assert issubclass(platform, Platform)
    specs = []
    for number, table in enumerate(config.sensor):
        with problems.gather():
            if table.kind not in platform.sensor_kinds:
                hint = nearest(table.kind, list(platform.sensor_kinds))
                raise ConfigError(f"sensor.{number}.kind: {platform.name} has no sensor of kind {table.kind!r}{hint}")
            if table.name in ("odometry", "contact", "truth"):
                raise ConfigError(f"sensor.{number}.name: {table.name!r} is a port of every platform; choose another")
            if table.kind in platform.sensor_settings:
                check_params(platform.sensor_settings[table.kind], table.params, f"sensor.{number}")
            specs.append(SensorSpec(table.name, table.kind, table.params))
    return tuple(specs)


def _stride(table: RoleTable, period: float, place: str) -> None:
    if table.rate_hz is not None:
        ratio = 1.0 / (table.rate_hz * period)
        if round(ratio) < 1 or not math.isclose(ratio, round(ratio), rel_tol=1e-6):
            tick_rate = 1.0 / period
            near = tick_rate / max(1, round(ratio))
            raise ConfigError(
                f"{place}.rate_hz: {table.rate_hz:g} does not divide the tick rate of {tick_rate:g} Hz; "
                f"the nearest that does is {near:g}"
            )


def _explains(table: RoleTable, place: str, role: str) -> None:
    if table.diagnostics_rate_hz is not None and role != "avoider":
        raise ConfigError(f"{place}.diagnostics_rate_hz: only an avoider gives diagnostics, this is a {role}")


def _task(config: Config, world: World | None) -> tuple[Pose2D, PlaceTable | None, float]:
    """Start, goal and tolerance: the config's, else the world's."""
    navigation = config.navigation
    if navigation.start is not None:
        heading = math.radians(math.remainder(navigation.start.heading_deg or 0.0, 360.0))
        start = Pose2D(navigation.start.x, navigation.start.y, heading)
    elif world is not None and world.start is not None:
        start = Pose2D(world.start.x, world.start.y, world.start.heading)
    else:
        start = Pose2D(0.0, 0.0, 0.0)
    goal = navigation.goal
    if goal is None and world is not None and world.goal is not None:
        goal = PlaceTable(x=world.goal.x, y=world.goal.y)
    authored = world.goal_tolerance if world is not None else None
    return start, goal, navigation.goal_tolerance or authored or 0.2


def _check_set_events(system: System, problems: Gathered) -> None:
    """Refuse parameter changes that will not fit when their time comes."""
    from navloom.engine.events import assignments

    for number, event, source in _set_events(system.config):
        with problems.gather(), _blamed_on_event(number):
            changed_params(system, *source, assignments(event.values))


def _set_events(config: Config) -> Iterator[tuple[int, EventTable, tuple[str, str]]]:
    """Number of each event that changes parameters, it, and the role and instance whose they are."""
    for number, event in enumerate(config.event):
        if event.do == "set":
            role = event.role or ""
            yield number, event, (role, event.name or config.role_table(role).instance)


@contextmanager
def _blamed_on_event(number: int) -> Iterator[None]:
    """Say which event of the config does not fit."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(*(f"event.{number}.values: {problem}" for problem in error.problems)) from None
