"""Makes the plugins of a checked config, and the nodes that run them."""

from __future__ import annotations

import gc
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

from pydantic import ValidationError

from navloom.config import ConfigError, check_params
from navloom.config.config_errors import Gathered, problems_of
from navloom.engine.event_schedule import disturbances
from navloom.engine.nodes.node_base import NodeSettings
from navloom.engine.nodes.node_plugin import NodePlugin
from navloom.engine.parameter_changes import blamed_on_event, changed_params, set_events
from navloom.engine.plugin_instances import Part
from navloom.engine.random_streams import stream_source
from navloom.engine.stepper import fault_text
from navloom.engine.system import System
from navloom.geometry.moving_world import standing
from navloom.geometry.world import World
from navloom.kernel_progress import expect_kernels
from navloom.messages.packing import writer_of
from navloom.navigation import blocked_trajectory, collision_monitor, handover, trajectory, trajectory_projection
from navloom.plugins import PluginError
from navloom.roles import FIXED, ROLES, Context, Role

__all__ = ["blamed_on_part", "configure", "make_plugins", "role_nodes", "try_plugins"]

Progress = Callable[[str], None]
YOUNG_OBJECTS = 10_000
"""New objects between two collections of the youngest generation; Python's default, 700, is a dozen ticks."""
COMPILED_OBJECTS = 50_000
"""The same while kernels compile, which makes many objects: with the default, it takes a tenth longer."""
FRAMEWORK: tuple[Any, ...] = (blocked_trajectory, handover, collision_monitor, trajectory, trajectory_projection)
"""Modules whose kernels every process needs."""
# 2 kB each. At a fixed rate and not on demand, because a trace must not depend on what is recorded or viewed.
DIAGNOSTICS_RATE_HZ = 2.0
"""Default rate of an avoider's diagnostics, Hz."""


def make_plugins(
    system: System, progress: Progress = lambda text: None, only: Collection[tuple[str, str]] | None = None
) -> None:
    """Make every plugin, or those of some instances, and compile their kernels, so that no tick has to compile.

    Raises:
        ConfigError: A plugin refuses its world, sensors or map.
    """
    wanted = {source: part for source, part in system.parts.items() if only is None or source in only}
    expect_kernels([*(module.__name__ for module in FRAMEWORK), *(part.cls for part in wanted.values())])
    before = gc.get_threshold()
    gc.set_threshold(COMPILED_OBJECTS, 20, 100)
    try:
        _make(system, wanted, progress)
    finally:
        gc.set_threshold(*before)
    _spare_what_is_loaded()


def _make(system: System, wanted: Mapping[tuple[str, str], Part], progress: Progress) -> None:
    progress("preparing the framework")
    # Compiled before the first tick: a kernel takes seconds, and a robot that drives must not wait for it.
    for module in FRAMEWORK:
        _warm_up(module)
    for spec in system.specs:
        for port in spec.ports:
            # Generated on first use, which would fall into a tick.
            writer_of(port.carries)
    for (role, _), part in wanted.items():
        progress(f"preparing {role} {part.cls.name}")
        with blamed_on_part(part, "warm_up"):
            _warm_up(part.cls)
        part.plugin = _made(system, part)


@cache
def _warm_up(source: Any) -> None:
    """Compile the kernels of a class or module once: alternatives, and robots of one process, share them."""
    source.warm_up()


@cache
def _spare_what_is_loaded() -> None:
    """Exclude the loaded libraries from garbage collection: a full collection over them takes a tick or two.

    New objects are also collected less often than by default: messages hold no cycles, so there is little to find.
    """
    # A collection over all objects of the libraries pauses a process for longer than a tick.
    gc.freeze()
    gc.set_threshold(YOUNG_OBJECTS)


def try_plugins(system: System) -> None:
    """Make every plugin once and discard it, without compiling: finds what only a plugin itself can refuse.

    A real platform is left out, since it would open the robot's ports.

    Raises:
        ConfigError, PluginError: One line for each plugin that cannot be made.
    """
    problems = Gathered()
    for part in system.parts.values():
        # A driver opens the robot's ports in its constructor.
        if part.role != "platform" or getattr(part.cls, "is_simulated", False):
            with problems.gather():
                _made(system, part)
    problems.refuse(system.loaded.error)


def _made(system: System, part: Part) -> Role:
    """A new plugin. Its `set` events are tried too."""
    config, role, instance = system.config, part.role, part.table.instance
    context = Context(
        instance=instance,
        period=config.run.period,
        robot=system.robot,
        stream=stream_source(config.run.seed, role, instance),
        # Only the simulator knows where the robot really stands; everybody else gets what the robot believes.
        start=system.true_start if role == "platform" else system.start,
        sensors=system.sensors if role == "platform" else (),
        # The ground truth is for the simulator only; others would not find it on a real robot.
        world=_simulated_world(system) if role == "platform" else None,
        disturbances=disturbances(config) if role == "platform" else (),
        map=system.map if role in ROLES and ROLES[role].facts.sees_map else None,
        start_sigma=system.start_sigma if role == "localizer" else None,
        diagnostics_rate_hz=DIAGNOSTICS_RATE_HZ if (rate := part.table.diagnostics_rate_hz) is None else rate,
    )
    with blamed_on_part(part, "__init__"):
        plugin = part.cls(part.params, context)
    if role not in FIXED:  # a second platform might take the robot's ports from the first
        _try_set_events(system, part, context)
    return plugin


def _simulated_world(system: System) -> World | None:
    """The ground truth for the platform; without what moves there if a node tells it of that."""
    world = system.world
    return standing(world) if world is not None and "world" in system.catalogue.nodes else world


def _try_set_events(system: System, part: Part, context: Context) -> None:
    """Refuse `set` events whose parameters the plugin would refuse during the run."""
    values: dict[str, Any] = part.params.model_dump(exclude_unset=True)
    for number, event, source in sorted(set_events(system.config), key=lambda entry: entry[1].at):
        if source == (part.role, part.table.instance):
            values |= event.values
            with blamed_on_event(number), blamed_on_part(part, "configure"):
                stream = stream_source(system.config.run.seed, *source)
                part.cls(check_params(part.cls.Params, values, part.place), replace(context, stream=stream))


@contextmanager
def blamed_on_part(part: Part, verb: str) -> Iterator[None]:
    """Turn an exception of a plugin into ConfigError if it refuses its config, else into PluginError."""
    try:
        yield
    except ValidationError as error:
        raise ConfigError(*problems_of(error, part.cls.Params, part.place)) from None
    except ValueError as error:
        raise ConfigError(f"{part.place} ({part.cls.name}): {error}") from None
    # A plugin that calls `sys.exit` must not end the process of other nodes.
    except (Exception, SystemExit) as error:
        text = fault_text(error, part.cls)
        raise PluginError(f"{part.place}.plugin: {part.cls.name} fails in {verb}: {text}") from None


def role_nodes(system: System, only: Collection[tuple[str, str]] | None = None) -> dict[tuple[str, str], Any]:
    """A node for each plugin, or for those of some instances."""
    settings = NodeSettings(
        system.config.navigation, system.robot, system.goal_tolerance, system.sensors, system.map_world,
        system.config.robot.name,
    )  # fmt: skip
    nodes: dict[tuple[str, str], Any] = {}
    for key in system.parts if only is None else [key for key in system.parts if key in only]:
        plugin = system.plugin(*key)
        is_node = isinstance(plugin, NodePlugin)
        nodes[key] = plugin if is_node else system.catalogue.nodes[key[0]].around(plugin, settings)
    return nodes


def configure(system: System, role: str, instance: str, assignments: tuple[str, ...]) -> None:
    """Change some of an instance's parameters, all or none: a plugin that refuses them is left unchanged.

    Raises:
        ConfigError: The values do not fit, or not together; PluginError: the plugin fails on them.
    """
    params = changed_params(system, role, instance, assignments)
    plugin = system.plugin(role, instance)
    # `configure` may fail half way; a plugin must keep its old parameters as a whole.
    before = dict(vars(plugin))
    try:
        with blamed_on_part(system.parts[(role, instance)], "configure"):
            plugin.configure(params)
    # Also for Ctrl-C: whatever ends `configure`, the plugin keeps its old parameters.
    except BaseException:
        # In place: the plugin itself, and nodes that refer to it, must stay the same object.
        vars(plugin).clear()
        vars(plugin).update(before)
        raise
