"""Assembles a system from a config: finds the plugins, and checks parameters, world, sensors and wiring."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from navloom.config import ConfigError, Loaded, check_params
from navloom.config.config_errors import Gathered
from navloom.config.schema import Config
from navloom.config.tables import GOAL_TOLERANCE, EventTable, MapTable, PlaceTable, RobotTable, RoleTable
from navloom.engine.catalogue import Catalogue
from navloom.engine.node_ports import Port
from navloom.engine.parameter_changes import blamed_on_event, changed_params, set_events
from navloom.engine.platform_world import world_of_platform
from navloom.engine.plugin_instances import Part, catalogue_of_parts, connect, find_parts, find_streams, sensors_of
from navloom.engine.starts import check_search, starts_of
from navloom.engine.streams import OWN_PORTS, sensor_port
from navloom.engine.system import System
from navloom.geometry import moving_world
from navloom.geometry.actors import Actor
from navloom.geometry.footprints import FootprintError, disc, polygon, rectangle
from navloom.geometry.world import World
from navloom.inputs.assignments import assignments
from navloom.messages import OccupancyGrid, Pose2D, RangeScan
from navloom.navigation.approach import SLOWEST, least_tolerance
from navloom.parts import has_part
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import nearest
from navloom.roles import ROLES, Platform, RobotSpec, Role, SensorSpec
from navloom.worlds.actor_tables import ACTOR_KEYS, actor_of
from navloom.worlds.toml_table import FileTable
from navloom.worlds.world_errors import WorldError

__all__ = ["assemble", "robot_spec"]


def robot_spec(table: RobotTable) -> RobotSpec:
    """The description of the robot that plugins receive. Raises ConfigError for an impossible footprint."""
    shape = table.footprint
    try:
        if shape.polygon is not None:
            outline = polygon(shape.polygon)
        elif shape.radius is not None:
            outline = disc(shape.radius)
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
        table.drive,
        table.wheelbase or 0.0,
        math.radians(table.max_steering_deg or 0.0),
        math.inf if table.max_steering_rate_deg is None else math.radians(table.max_steering_rate_deg),
    )


def assemble(loaded: Loaded, discovery: Discovery | None = None) -> System:
    """Find the plugins, and check their parameters and the wiring. No plugin is made yet.

    Raises:
        ConfigError: Something in the file does not fit; one line a problem. PluginError: a plugin cannot be used.
    """
    config, problems = loaded.config, Gathered()
    discovery = discovery or Discovery(config.plugins.blocked)
    parts, world, robot = find_parts(config, discovery, problems), None, None
    platform_part = parts.get(("platform", config.platform.instance))
    with problems.gather():
        world = _world(loaded, discovery, platform_part)
    # A simulator with a world of its own moves what moves there, and a real robot meets what is really there.
    moves = config.world is not None and world is not None and (bool(loaded.member) or moving_world.moves(world))
    catalogue = catalogue_of_parts(config, parts, problems, moves and is_simulated(platform_part))
    with problems.gather():
        robot = robot_spec(config.robot)
    sensors = _sensors(config, platform_part.cls, problems) if platform_part is not None else ()
    for place, role, table in config.role_tables():
        with problems.gather():
            _stride(table, config.run.period, place)
            _explains(table, place, role)
    ports: dict[str, Port[Any]] = {}
    if platform_part is not None and len(sensors) == len(config.sensor):
        cls = platform_part.cls
        assert issubclass(cls, Platform)
        ports = {
            table.name: sensor_port(
                table.name, cls.sensor_kinds[table.kind], table.time_offset, table.kind in cls.true_kinds
            )
            for table in config.sensor
        }
        for part in parts.values():
            with problems.gather():
                part.sensors = sensors_of(part, cls, sensors)
    if len(parts) == len(config.role_tables()):
        for part in parts.values():
            with problems.gather():
                part.streams = find_streams(part, [*catalogue.ports(), *ports.values()])
    # Each stage needs what the previous ones found: all problems of one stage are told together, then it ends.
    problems.refuse(loaded.error)
    assert robot is not None and platform_part is not None
    with problems.gather():
        system = _system(loaded, robot, world, parts, sensors, catalogue, ports)
    problems.refuse(loaded.error)
    with problems.gather():
        if config.map is not None or any(part.cls.needs_map for part in parts.values()):
            system.map_world = known = _known_world(loaded, discovery, world)
            system.map = grid_of(known, (config.map or MapTable()).resolution, config.robot.height)
    _check_disturbances(system, problems)
    _check_set_events(system, problems)
    with problems.gather():
        check_search(system, discovery)
    problems.refuse(loaded.error)
    return system


def is_simulated(platform: Part | None) -> bool:
    """Whether a config's platform is a simulator."""
    return platform is not None and issubclass(platform.cls, Platform) and platform.cls.is_simulated


def _system(
    loaded: Loaded,
    robot: RobotSpec,
    world: World | None,
    parts: dict[tuple[str, str], Part],
    sensors: tuple[SensorSpec, ...],
    catalogue: Catalogue,
    ports: Mapping[str, Port[Any]],
) -> System:
    config = loaded.config
    platform = parts[("platform", config.platform.instance)].cls
    assert issubclass(platform, Platform)
    ranging = [name for name, port in ports.items() if issubclass(port.carries, RangeScan)]
    specs, wiring = connect(catalogue, parts, ports, ranging if config.gate.monitor else ())
    goal, tolerance = _task(config, world)
    start, start_sigma, true_start = starts_of(config, world)
    mapper = set(parts[("mapper", config.mapper.instance)].sensors)
    asks = any(sensor.name in mapper and platform.scans_on_request(sensor) for sensor in sensors)
    system = System(
        loaded, robot, world, start, start_sigma, true_start, goal, tolerance, catalogue, specs, wiring, parts,
        sensors, asks,
    )  # fmt: skip
    # Checked here, because the goal would otherwise be missed each time, which nobody would trace to these four values.
    least = least_tolerance(system.braking)
    if tolerance < least:
        raise ConfigError(
            f"navigation.goal_tolerance: is {tolerance:g} m, but this robot needs {least:.2g} m to stop from "
            f"{SLOWEST:g} m/s, by run.period, robot.motor_lag, robot.dead_time and robot.max_deceleration: "
            "expected at least that"
        )
    return system


def stride_of(table: RoleTable, period: float) -> int:
    """Ticks between steps of a node."""
    return 1 if table.rate_hz is None else round(1.0 / (table.rate_hz * period))


def _world(loaded: Loaded, discovery: Discovery, platform: Part | None) -> World | None:
    """The true world: the config's, or the platform's own."""
    own = None if platform is None else world_of_platform(platform)
    if loaded.config.world is None:
        _refuse_actors(loaded.config, "there is no [world] in which it could appear")
        return own
    if own is not None:
        raise ConfigError(
            f"world.ref: is {loaded.config.world.ref!r}, but the platform {loaded.config.platform.plugin} brings a "
            "world of its own: leave [world] and --worlds out"
        )
    world = _resolve(loaded, discovery, "world.ref", loaded.config.world.ref)
    added = [_actor_of(number, event) for number, event in enumerate(loaded.config.event) if event.do == "actor"]
    if added and not is_simulated(platform):
        _refuse_actors(loaded.config, "the platform is a real robot")
    taken = [obstacle.name for obstacle in world.obstacles] + [actor.name for actor in world.actors]
    for name in [actor.name for actor in added]:
        if name in taken:
            raise ConfigError(f"event: an actor is named {name!r}, as another in the world: name it otherwise")
        taken.append(name)
    world = replace(world, actors=(*world.actors, *added)) if added else world
    if loaded.config.robot.name in taken and (moving_world.moves(world) or loaded.member):
        raise ConfigError(f"robot.name: is {loaded.config.robot.name!r}, as something in the world: name it otherwise")
    if moving_world.walks(world) and not has_part("navloom_orca"):
        raise ConfigError(f"world.ref: actors of {world.name} have goals, which needs navloom-orca: install it")
    return _for_member(world, loaded) if loaded.member else world


def _for_member(world: World, loaded: Loaded) -> World:
    """The world with the start and goal of a member; as it is if it has no task for each robot."""
    if not world.tasks:
        return world
    if loaded.number >= len(world.tasks):
        raise ConfigError(
            f"world.ref: {world.name} has tasks for {len(world.tasks)} robots, and {loaded.member} is number "
            f"{loaded.number + 1}: give it an option for more, or lower member.count"
        )
    start, goal = world.tasks[loaded.number]
    return replace(world, start=start, goal=goal)


def _actor_of(number: int, event: EventTable) -> Actor:
    """The actor that an event lets appear; its course begins then."""
    try:
        table = FileTable(Path(f"event.{number}.values"), "", event.values, ACTOR_KEYS)
        if "appears_at" in table:
            raise table.error("appears_at has no use in an event, which has at: leave it out")
        return actor_of(table, event.name or f"actor {number}", event.at)
    except WorldError as error:
        raise ConfigError(str(error)) from None


def _refuse_actors(config: Config, why: str) -> None:
    for number, event in enumerate(config.event):
        if event.do == "actor":
            raise ConfigError(f'event.{number}.do: is "actor", but {why}: leave the event out')


def _resolve(loaded: Loaded, discovery: Discovery, place: str, reference: str) -> World:
    try:
        return discovery.world(reference, loaded.base_of(place))
    except (PluginError, ValueError) as error:
        raise ConfigError(f"{place}: {error}") from None


def _known_world(loaded: Loaded, discovery: Discovery, world: World | None) -> World:
    """The world of the known map."""
    table = loaded.config.map or MapTable()
    if table.ref != "world":
        world = _resolve(loaded, discovery, "map.ref", table.ref)
    if world is None:
        raise ConfigError(
            'map.ref: is "world", but there is no [world], and the platform has none; name a map, as in '
            'ref = "rosmap:F.yaml"'
        )
    return world


def grid_of(world: World, resolution: float, height: float) -> OccupancyGrid:
    """What is mapped of a world, as a map: its own raster if that is all, otherwise rasterised at `resolution`, m.

    It is made once for each world: robots in one world share it.
    """
    grids = _GRIDS.setdefault(world, {})
    if (resolution, height) not in grids:
        grids[resolution, height] = _grid_of(world, resolution, height)
    return grids[resolution, height]


_GRIDS: WeakKeyDictionary[World, dict[tuple[float, float], OccupancyGrid]] = WeakKeyDictionary()


def _grid_of(world: World, resolution: float, height: float) -> OccupancyGrid:
    # Its kernels take long to load, and most configs have no world to rasterise.
    from navloom.geometry.grid import world_to_grid

    world = replace(world, obstacles=tuple(obstacle for obstacle in world.obstacles if obstacle.is_mapped))
    raster = world.raster
    # A raster that is rasterised again would shift every wall by up to half a cell.
    if raster is not None and not world.obstacles:
        cells = np.multiply(raster.occupied, 100, dtype=np.int8)
        return OccupancyGrid(cells, raster.resolution, Pose2D(raster.origin.x, raster.origin.y, raster.origin.heading))
    grid = world_to_grid(world, resolution, (0.0, height))
    return OccupancyGrid(grid.cells, grid.resolution, Pose2D(grid.origin.x, grid.origin.y, grid.origin.heading))


def _sensors(config: Config, platform: type[Role], problems: Gathered) -> tuple[SensorSpec, ...]:
    """The config's sensors, checked against the kinds that the platform has."""
    assert issubclass(platform, Platform)
    specs = []
    for number, table in enumerate(config.sensor):
        with problems.gather():
            if table.kind not in platform.sensor_kinds:
                hint = nearest(table.kind, list(platform.sensor_kinds))
                raise ConfigError(f"sensor.{number}.kind: {platform.name} has no sensor of kind {table.kind!r}{hint}")
            # A sensor's name becomes a port beside these.
            if table.name in OWN_PORTS:
                raise ConfigError(f"sensor.{number}.name: {table.name!r} is a port of every platform; choose another")
            message = platform.sensor_kinds[table.kind]
            if table.time_offset and not hasattr(message, "stamp_ns"):
                raise ConfigError(
                    f"sensor.{number}.time_offset: is {table.time_offset:g} s, but {message.__name__}, which "
                    f"{table.kind} gives, has no stamp_ns: expected 0"
                )
            if table.kind in platform.sensor_settings:
                check_params(platform.sensor_settings[table.kind], table.params, f"sensor.{number}")
            specs.append(SensorSpec(table.name, table.kind, table.params))
    return tuple(specs)


def _stride(table: RoleTable, period: float, place: str) -> None:
    if table.rate_hz is not None:
        ratio = 1.0 / (table.rate_hz * period)
        # Steps fall on ticks: another rate would have to alternate between two intervals.
        if round(ratio) < 1 or not math.isclose(ratio, round(ratio), rel_tol=1e-6):
            tick_rate = 1.0 / period
            near = tick_rate / max(1, round(ratio))
            raise ConfigError(
                f"{place}.rate_hz: {table.rate_hz:g} does not divide the tick rate of {tick_rate:g} Hz; "
                f"the nearest that does is {near:g}"
            )


def _explains(table: RoleTable, place: str, role: str) -> None:
    explains = [owner for owner, cls in ROLES.items() if cls.facts.gives_diagnostics]
    if table.diagnostics_rate_hz is not None and role not in explains:
        raise ConfigError(
            f"{place}.diagnostics_rate_hz: only the {' and the '.join(explains)} gives diagnostics, this is the {role}"
        )


def _task(config: Config, world: World | None) -> tuple[PlaceTable | None, float]:
    """Goal and tolerance: from the config, otherwise from the world."""
    navigation = config.navigation
    goal = navigation.goal
    if goal is None and world is not None and world.goal is not None:
        goal = PlaceTable(x=world.goal.x, y=world.goal.y)
    authored = world.goal_tolerance if world is not None else None
    return goal, navigation.goal_tolerance or authored or GOAL_TOLERANCE


def _check_disturbances(system: System, problems: Gathered) -> None:
    """Refuse events that move the robot from outside, or let its wheels slip, where the platform cannot do so."""
    table = system.config.platform
    platform = system.parts["platform", table.instance].cls
    if not (issubclass(platform, Platform) and platform.takes_disturbances):
        for number, event in enumerate(system.config.event):
            if event.do in ("displace", "slip"):
                with problems.gather():
                    kind = "simulated" if getattr(platform, "is_simulated", False) else "real"
                    raise ConfigError(
                        f'event.{number}.do: the platform {table.plugin}, a {kind} robot, cannot "{event.do}"; take a '
                        "simulated one that can, as sensors_sim, or leave the event out"
                    )


def _check_set_events(system: System, problems: Gathered) -> None:
    """Refuse `set` events whose parameters would not fit during the run."""
    for number, event, source in set_events(system.config):
        with problems.gather(), blamed_on_event(number):
            changed_params(system, *source, assignments(event.values))
