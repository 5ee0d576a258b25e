"""Checks of a task before the first tick: sensors, limits, and places in the true world where one is known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom.engine.build import stride_of
from navloom.engine.plugin_instances import Part
from navloom.engine.system import System
from navloom.geometry.collision import clearance, unknown_remedy
from navloom.geometry.footprints import inscribed_radius
from navloom.geometry.world import Place
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import NODE
from navloom.roles import ROLES, Params, Platform, Role

__all__ = ["LEAST_HANG_TIMEOUT", "PlaceProblem", "check_live", "check_task", "is_real", "place_problem"]

LEAST_HANG_TIMEOUT = 1.5
"""Shortest `live.hang_timeout`, s: a live node may wait so long for a reader until its link is closed."""


def is_real(system: System) -> bool:
    """The platform is the driver of a real robot, which simulated time must not move."""
    return not getattr(_platform(system), "is_simulated", True)


def _platform(system: System) -> type[Platform[Params]]:
    platform = system.parts[("platform", system.config.platform.instance)].cls
    assert issubclass(platform, Platform)
    return platform


def check_task(system: System) -> None:
    """Refuse a simulated run of a real robot, without a goal, or of a robot that cannot drive.

    A robot cannot drive if a plugin lacks its sensors, if commands arrive stale, or if the start or goal is occupied in
    the true world.

    Raises:
        ConfigError: One line for each problem.
    """
    config = system.config
    if is_real(system):
        name = config.platform.plugin
        raise system.loaded.error(
            f"platform.plugin: {name} drives a real robot, which simulated time must not move; `navloom up` drives it"
        )
    gives_goal = any(event.do == "goal" for event in config.event)
    has_goal = gives_goal or (system.goal is not None and config.navigation.drive)
    _check_drive(
        system,
        *(() if has_goal else (
            "navigation.goal: is missing, and the world names none; give one, as in goal = { x = 0.0, y = 7.6 }",
        )),
    )  # fmt: skip


def _check_drive(system: System, *more: str) -> None:
    """Refuse a robot that cannot drive. Raises ConfigError with one line for each problem, after those in `more`."""
    problems = [*more, *_places(system), *_needed_sensors(system), *_delays(system), *_robot(system)]
    if problems:
        raise system.loaded.error(*problems)


def check_live(system: System) -> None:
    """Refuse a live robot that cannot drive, as in `check_task`, or whose limits would stop or end it in every drive.

    Raises:
        ConfigError: One line for each problem.
    """
    _check_drive(system, *_limits(system))


def _limits(system: System) -> Iterator[str]:
    """Limits that no live robot can hold: lockstep has no time between two ticks, and waits for no reader."""
    config = system.config
    period, gate = config.run.period, config.gate
    for name, limit in (("stop_deadline", gate.stop_deadline), ("sensor_timeout", gate.sensor_timeout)):
        # Between two ticks every stamp is a period old.
        if limit <= period:
            yield (
                f"gate.{name}: is {limit:g} s; expected more than run.period = {period:g} s, or a live robot stops in "
                f"every tick; give {2.0 * period:g} s or more"
            )
    if config.live.hang_timeout < LEAST_HANG_TIMEOUT:
        yield (
            f"live.hang_timeout: is {config.live.hang_timeout:g} s; expected {LEAST_HANG_TIMEOUT:g} s or more: a node "
            "may wait so long for another process that does not answer, and would be ended for it"
        )


def _places(system: System) -> Iterator[str]:
    """Problems of a start or goal where the robot does not fit in the true world."""
    start, goal = system.true_start, system.goal
    problem = place_problem(system, start.x, start.y, start.heading)
    if problem:
        own = system.config.world
        key = "navigation.start" if own is None or own.start is None else "world.start"
        yield f"{key}: {problem.text}"
    if goal is not None:
        heading = None if goal.heading_deg is None else math.radians(goal.heading_deg)
        problem = place_problem(system, goal.x, goal.y, heading)
        if problem:
            yield f"navigation.goal: {problem.text}"


def _delays(system: System) -> Iterator[str]:
    """Problems of delays: commands that are stale when they reach the gate, and answers later than their timeout."""
    config, limit = system.config, system.config.gate.stop_deadline
    drivers = ("controller",) if config.navigation.handover == "never" else ("controller", "avoider")
    for driver in drivers:
        ages = {role: _age(system, role) for role in ("localizer", driver)}
        # Delays add up along the chain, but only the longest hold counts: a fresh pose waits for the next slow step
        # once.
        age = sum(late for late, _ in ages.values()) + max(rest for _, rest in ages.values())
        # Periods are sums of floating point numbers: a limit of exactly two ticks must allow two ticks.
        if age > limit + 1e-9:
            role = max(ages, key=lambda role: sum(ages[role]))
            key = "latency" if ages[role][0] > 0.0 else "rate_hz"
            yield (
                f"{role}.{key}: is {getattr(config.role_table(role), key):g}: the {driver}'s commands are up to "
                f"{age:g} s old when they reach the gate, which stops beyond gate.stop_deadline = {limit:g} s; "
                f"make the {role} faster, or raise the deadline"
            )
            break
    for role, wait in (("mapper", "map_timeout"), ("planner", "plan_timeout")):
        late, longest = config.role_table(role).latency, getattr(config.navigation, wait)
        if late >= longest:
            yield f"{role}.latency: is {late:g} s; expected less than navigation.{wait} = {longest:g} s"


def _age(system: System, role: str) -> tuple[float, float]:
    """Delay of a role's answers, s, and how much longer than one tick each stays the newest, s."""
    table, period = system.config.role_table(role), system.config.run.period
    return period * math.ceil(round(table.latency / period, 6)), period * (stride_of(table, period) - 1)


def _robot(system: System) -> Iterator[str]:
    """Problems of the robot: a reference that is always faster than it, and a real robot of unknown size."""
    config = system.config
    fastest = config.robot.max_linear
    slowest = config.navigation.speeds(fastest)[0]
    if slowest > fastest:
        yield (
            f"navigation.speed: begins with {slowest:g} m/s, more than robot.max_linear = {fastest:g} m/s: the robot "
            f"cannot follow; expected at most that: leave it out, then it follows from the robot (--set "
            "navigation.speed=default)"
        )
    if is_real(system) and not system.loaded.gives("robot.footprint"):
        yield (
            f"robot.footprint: is missing, and {config.platform.plugin} is a real robot: give its size, as in "
            "footprint = { length = 0.5, width = 0.4 }"
        )


class PlaceProblem(NamedTuple):
    """Why the robot does not fit at a place in the true world, and whether the place is outside it."""

    text: str
    is_outside: bool = False


def place_problem(system: System, x: float, y: float, heading: float | None) -> PlaceProblem | None:
    """Why the robot does not fit at a place in the true world, m and rad; None if it fits or no world is known."""
    world, outline = system.world, system.robot.footprint
    if world is None:
        return None
    left, low, right, high = world.bounds
    if not (left <= x <= right and low <= y <= high):
        return PlaceProblem(
            f"({x:g}, {y:g}) is outside the world {world.name}, "
            f"which reaches from ({left:g}, {low:g}) to ({right:g}, {high:g}) m",
            is_outside=True,
        )
    # Without a heading the planner may choose any: only what is covered at every heading must be free.
    shape = outline if heading is not None else _disc(inscribed_radius(outline))
    place, height = Place(x, y, heading or 0.0), system.robot.height
    gap, name = clearance(shape, place, world, height=height)
    if gap > 0.0:
        return None
    why = unknown_remedy(shape, place, world, height) or f"occupied by {name}"
    return PlaceProblem(f"the robot does not fit at ({x:g}, {y:g}): {why}")


def _disc(radius: float) -> NDArray[np.float64]:
    """(16, 2) corners of a polygon within a disc, m: the area that a robot covers at any heading."""
    angles = np.arange(16) * (math.tau / 16)
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))


def _needed_sensors(system: System) -> Iterator[str]:
    """One problem, with fixes, for each plugin that needs a sensor and has none that it accepts."""
    for part in system.parts.values():
        # An avoider that never drives may stay blind.
        is_idle = part.role == "avoider" and system.config.navigation.handover == "never"
        if part.cls.needs_sensor and part.cls.accepts and not part.sensors and not is_idle:
            yield _without_sensor(system, part)


def _without_sensor(system: System, part: Part) -> str:
    messages = " or ".join(message.__name__ for message in part.cls.accepts)
    key, default = "plugin", "" if system.loaded.gives(f"{part.place}.plugin") else ", the default,"
    if part.table.sensors is not None:
        key, has = "sensors", "this list names none"
    else:
        present = ", ".join(sorted({sensor.kind for sensor in system.sensors}))
        has = f"there is none among {present}" if present else "there is no [[sensor]]"
    kinds = [kind for kind, message in _platform(system).sensor_kinds.items() if issubclass(message, part.cls.accepts)]
    fixes = [f"add a [[sensor]] of kind {' or '.join(kinds)}"] if kinds and part.table.sensors is None else []
    if others := _others(system, part):
        fixes.append(f"take another {part.role}, as {' or '.join(others)}")
    if part.role == "avoider":
        fixes.append('set navigation.handover = "never"')
    helps = f": {', or '.join(fixes)}" if fixes else ""
    return f"{part.place}.{key}: {part.cls.name}{default} needs a sensor that gives {messages}, and {has}{helps}"


def _others(system: System, part: Part) -> list[str]:
    """Plugins of the same role that can work with the configured sensors."""
    given = [_platform(system).sensor_kinds[sensor.kind] for sensor in system.sensors]
    discovery, found = Discovery(system.config.plugins.blocked), []
    for name in discovery.names(part.role if part.role in ROLES else NODE):
        try:
            cls: type[Role] = discovery.plugin(part.role, name)
        # A broken plugin is no fix; `navloom plugins` tells about it.
        except PluginError:
            continue
        if not (cls.needs_sensor and cls.accepts) or any(issubclass(message, cls.accepts) for message in given):
            found.append(name)
    return found
