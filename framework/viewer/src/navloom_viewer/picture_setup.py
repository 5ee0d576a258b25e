"""What a viewer knows before the first message: the robots in the picture, their places and plugins."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from navloom.geometry.echoes import Geometry
from navloom.geometry.moving_world import standing
from navloom.geometry.world import World
from navloom.messages import Pose2D
from numpy.typing import NDArray

from navloom_viewer.colours import ACTOR, Colour

if TYPE_CHECKING:
    from navloom.engine.system import System

__all__ = ["LANES", "Actor", "Facts", "SweepRule", "Variant", "actors_of", "facts_of", "swappable_actors", "sweep_rule"]

UNKNOWN_RADIUS = 0.2
"""Radius of the disc for a robot with an unknown footprint, m."""


@dataclass(frozen=True)
class SweepRule:
    """How a mapper classifies the points of a sweep: the parameters of `ipabd` that define it.

    Attributes:
        floor_tolerance: Points within this height of the floor are floor, m.
        z_limit: Points above this height are overhead, m.
        minimum_first: Whether the nearest point of each bearing is chosen before the heights are tested, as in the
            paper.
        min_range, max_range_tolerance: Margins of the valid range in addition to the sensor's limits, m.
        geometry: "as_sweep", "paper" or "rigid_pitch".
    """

    floor_tolerance: float = 0.06
    z_limit: float = 1.2
    minimum_first: bool = False
    min_range: float = 0.0
    max_range_tolerance: float = 0.05
    geometry: Geometry | Literal["as_sweep"] = "as_sweep"


@dataclass(frozen=True, eq=False)
class Variant:
    """One robot of the picture.

    Attributes:
        name: Name of the method, or of the robot if there is only one.
        plugins: Plugin by role, for the legend.
        instances: Active instance of each role at the start.
        shadows: (role, instance) of alternatives.
        footprint: (n, 2) m, base frame.
        height: Height of the robot, m.
        start: Start pose, map frame.
        goal: x, y, m, map frame, or None.
        goal_tolerance: Tolerance of the goal, m.
        sweep_rule: How its mapper classifies points.
        has_truth: Whether there is a world, so that the simulator knows the true pose.
    """

    name: str
    footprint: NDArray[np.float64]
    height: float
    start: Pose2D
    goal: tuple[float, float] | None
    goal_tolerance: float = 0.2
    plugins: Mapping[str, str] = field(default_factory=dict)
    instances: Mapping[str, str] = field(default_factory=dict)
    shadows: tuple[tuple[str, str], ...] = ()
    sweep_rule: SweepRule = SweepRule()
    has_truth: bool = True


@dataclass(frozen=True, eq=False)
class Facts:
    """Everything that a viewer knows before the first message.

    Attributes:
        title: Name of the recording in the viewer.
        variants: At least one robot. A single one is drawn in the colours of `run --out`.
        world: The true world, or None.
        period: Control period, s.
    """

    title: str
    variants: tuple[Variant, ...]
    world: World | None = None
    period: float = 0.05


@dataclass(frozen=True)
class Actor:
    """A variant, or one of its shadows: anything with its own colour.

    Attributes:
        name: Displayed name, also used in entity paths.
        variant: Name of the variant that it belongs to.
        colour: Its colour.
        is_shadow: Whether it is a shadow.
    """

    name: str
    variant: str
    colour: Colour
    is_shadow: bool

    def lane(self, name: str, is_alone: bool) -> str:
        """Entity path of a lane. The viewer shows it as the lane's name, so a single robot's name is left out."""
        return f"/{name}" if is_alone and not self.is_shadow else f"/{self.name}/{name}"


LANES = ("goal", "driver", "avoider")
"""Lanes of each robot in the state timeline; a shadow has only the last one."""


def actors_of(facts: Facts) -> dict[tuple[str, str, str], Actor]:
    """Actors by (variant, role, instance); role and instance ("", "") mean the variant itself."""
    single = len(facts.variants) == 1
    named: list[tuple[tuple[str, str, str], str, bool]] = []
    for variant in facts.variants:
        named.append(((variant.name, "", ""), variant.name, False))
    for variant in facts.variants:
        for role, instance in variant.shadows:
            name = instance if single and instance != variant.name else f"{variant.name}_{instance}"
            named.append(((variant.name, role, instance), name, True))
    return {
        key: Actor(name, key[0], ACTOR[number % len(ACTOR)], is_shadow)
        for number, (key, name, is_shadow) in enumerate(named)
    }


def swappable_actors(facts: Facts) -> dict[tuple[str, str, str], Actor]:
    """Actors of the instances that are active at the start and whose roles have shadows: after a swap they are some."""
    single, taken = len(facts.variants) == 1, len(actors_of(facts))
    actors: dict[tuple[str, str, str], Actor] = {}
    for variant in facts.variants:
        for role in dict.fromkeys(role for role, _ in variant.shadows):
            instance = variant.instances.get(role, "main")
            name = instance if single and instance != variant.name else f"{variant.name}_{instance}"
            colour = ACTOR[(taken + len(actors)) % len(ACTOR)]
            actors[variant.name, role, instance] = Actor(name, variant.name, colour, is_shadow=True)
    return actors


def facts_of(systems: Mapping[str, System], title: str) -> Facts:
    """The facts of assembled configs, by their displayed names; the world of the first one is drawn."""
    variants = tuple(_variant(name, system) for name, system in systems.items())
    first = next(iter(systems.values()))
    world = first.world
    if world is not None and "world" in first.catalogue.nodes:
        world = standing(world)  # what moves there is drawn from the messages of its node
    return Facts(title, variants, world, first.config.run.period)


def unknown_robot(name: str, roles: Mapping[str, str], shadows: tuple[tuple[str, str], ...] = ()) -> Variant:
    """A robot of which only the nodes are known, drawn as a small disc."""
    turns = np.linspace(0.0, math.tau, 16, endpoint=False)
    disc = UNKNOWN_RADIUS * np.column_stack([np.cos(turns), np.sin(turns)])
    return Variant(name, disc, 0.3, Pose2D(0.0, 0.0, 0.0), None, 0.2, roles, roles, shadows)


def _variant(name: str, system: System) -> Variant:
    config = system.config
    plugins, instances, shadows = {}, {}, []
    for (role, instance), part in system.parts.items():
        if role in instances:
            shadows.append((role, instance))
        else:
            instances[role], plugins[role] = instance, part.cls.name
    goal = None if system.goal is None else (system.goal.x, system.goal.y)
    # By name and with defaults: the viewer knows no plugin, and another mapper has none of these parameters.
    mapper = system.parts[("mapper", config.mapper.instance)].params
    robot = system.robot
    return Variant(
        name, robot.footprint, robot.height, system.drawn_start, goal, system.goal_tolerance, plugins, instances,
        tuple(shadows), sweep_rule(mapper, robot.height), system.world is not None,
    )  # fmt: skip


def sweep_rule(params: Any, height: float) -> SweepRule:
    """The rule from a mapper's parameters by name; a missing parameter has the paper's value."""
    z_limit = getattr(params, "z_limit", None)
    return SweepRule(
        floor_tolerance=getattr(params, "floor_tolerance", 0.06),
        z_limit=height if z_limit is None else z_limit,
        minimum_first=getattr(params, "filter_order", "before_min") == "paper",
        min_range=getattr(params, "min_range", 0.0),
        max_range_tolerance=getattr(params, "max_range_tolerance", 0.05),
        geometry=getattr(params, "geometry", "as_sweep"),
    )
