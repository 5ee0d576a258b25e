"""What the behaviour tier measures and reports, and how it makes a plugin for a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from navloom.engine.random_streams import stream_source
from navloom.errors import NavloomError
from navloom.geometry.frames import transform
from navloom.geometry.world import Box, World, read_only
from navloom.messages import MapUpdate, Message, OccupancyGrid, PlanRequest, Pose2D, RangeScan
from navloom.roles import Context, PlannerInput, RobotSpec, Role, SensorSpec
from navloom.roles.claims import Claim
from navloom.roles.extra import NO_EXTRAS, Extras, extras_of
from numpy.typing import NDArray

from navloom_check.behaviour.obstacle_scene import ALL_ROUND, Mount, Scene, grid_of
from navloom_check.drive_streams import Moment, framework_message, nothing_of, straight_way
from navloom_check.scenes import cast

__all__ = ["PERIOD", "PERIOD_NS", "Behaviour", "Line", "Maker", "Measured", "Unfit", "full_scan", "robot_of",
           "scan_from", "shrunk"]  # fmt: skip

Floats = NDArray[np.float64]

PERIOD_NS = 50_000_000
PERIOD = 1e-9 * PERIOD_NS
"""Control tick of the scenes, s."""
RAYS = 15
"""Rays over the width of a cone."""
LEVEL = 0.2
"""Height of lasers and sonars above the floor, m."""
TRIES = 60
"""Most scenes that are tried while a failing scene is reduced."""


class Unfit(NavloomError):
    """A scene does not suit a plugin, or cannot be judged; the text is the reason, as one phrase."""


@dataclass(frozen=True, eq=False)
class Line:
    """Something to draw in the picture of a scene: points (n, 2) or poses (n, 3), m, rad, map frame, and its name.

    Attributes:
        is_robot: The points are poses of the robot; the footprint is drawn at some of them.
        is_dots: The points are not joined.
    """

    name: str
    points: Floats
    is_robot: bool = False
    is_dots: bool = False


@dataclass(frozen=True, eq=False)
class Measured:
    """Result of one scene.

    Attributes:
        holds: The claim holds in the scene.
        said: What was measured, with units, as part of a sentence.
        value: The number that decides, in the behaviour's unit.
        lines: Lines of the picture.
        scenes: The two scenes that `lines` belong to in turn, if two were compared.
    """

    holds: bool
    said: str
    value: float
    lines: tuple[Line, ...] = ()
    scenes: tuple[Scene, ...] = ()


@dataclass(frozen=True)
class Maker:
    """Makes instances of one plugin, as the framework does.

    Attributes:
        cls: The plugin.
        params: Its checked parameters; None for the defaults.
        seed: Seed of its random streams.
        period: Control period in their context, s.
    """

    cls: type[Role]
    params: Any = None
    seed: int = 0
    period: float = PERIOD

    def extra(
        self,
        scene: Scene,
        stamp_ns: int,
        pose: tuple[float, float, float],
        twist: tuple[float, float] = (0.0, 0.0),
        **given: Any,
    ) -> Extras:
        """Its extra inputs at a moment of a drive to the scene's target; `given` as the attributes of `Moment`.

        Raises:
            Unfit: The plugin needs one that no scene has.
        """
        declared = extras_of(self.cls)
        if not declared:
            return NO_EXTRAS
        given.setdefault("samples", straight_way((scene.start.x, scene.start.y), scene.target))
        now = Moment(stamp_ns, pose, twist, **{"grid": lambda: _grid_of(scene), **given})
        held = {one: framework_message(one.carries, now) for one in declared.values()}
        for one in declared.values():
            if held[one] is None and not one.optional:
                held[one] = nothing_of(one.carries, stamp_ns)
        if missing := [f"{one.name} ({one.carries.__name__})" for one, held_one in held.items()
                       if held_one is None and not one.optional]:  # fmt: skip
            raise Unfit(f"it waits for extra inputs that no scene has: {', '.join(missing)}")
        return Extras(held)

    def asked(self, scene: Scene, request: PlanRequest, grid: OccupancyGrid, stamp_ns: int) -> PlannerInput:
        """The input of a planner: a request, a map, and its extra inputs at the start of the request."""
        start = (request.start.x, request.start.y, request.start.heading)
        extra = self.extra(scene, stamp_ns, start, grid=lambda: grid)
        return PlannerInput(request, MapUpdate(stamp_ns, grid, np.empty((0, 4)), ()), extra)

    def sees(self, kind: type[Message]) -> bool:
        """Whether the plugin takes sensor messages of a class."""
        return any(issubclass(kind, one) for one in self.cls.accepts)

    def __call__(
        self,
        scene: Scene,
        *,
        map: OccupancyGrid | None = None,
        world: World | None = None,
        sensors: tuple[SensorSpec, ...] = (),
    ) -> Any:
        """A new instance for the robot of a scene, at its start."""
        start = Pose2D(scene.start.x, scene.start.y, scene.start.heading)
        stream = stream_source(self.seed, self.cls.role, "check")
        context = Context("check", self.period, robot_of(scene), stream, start, sensors, world, map)
        return self.cls(self.cls.Params() if self.params is None else self.params, context)


@dataclass(frozen=True)
class Behaviour:
    """How one claim of one role is measured.

    Attributes:
        role, claim: The role and its claim.
        demand: What is demanded, as the end of a sentence "expected …".
        scene: Makes the scene of a seed.
        measure: Measures a new instance in a scene.
        scenes: Number of seeds, and so of scenes.
        shrinks: A failing scene may be reduced: with fewer obstacles it still shows the same fault.
    """

    role: str
    claim: Claim
    demand: str
    scene: Callable[[int], Scene]
    measure: Callable[[Maker, Scene], Measured]
    scenes: int
    shrinks: bool = True

    @property
    def name(self) -> str:
        """Name of its check."""
        return self.claim.value


@lru_cache(maxsize=4)
def _grid_of(scene: Scene) -> OccupancyGrid:
    """The map of a scene, drawn once for all ticks of a drive."""
    return grid_of(scene)


def robot_of(scene: Scene) -> RobotSpec:
    """The robot of a scene."""
    return RobotSpec(scene.outline, 1.0, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)


def full_scan(scene: Scene, pose: tuple[float, float, float], stamp_ns: int) -> RangeScan:
    """Scan of a laser in the middle of the robot, which is at a pose: x, y, m, heading, rad, map frame."""
    return scan_from(scene, ALL_ROUND[0], pose, stamp_ns)


def scan_from(scene: Scene, laser: Mount, pose: tuple[float, float, float], stamp_ns: int) -> RangeScan:
    """Scan of a laser or of a ring of sonars, of a robot that is at a pose: x, y, m, heading, rad, map frame."""
    bearings, origins, spread, half_angles, delays = _beams(laser)
    angles = (bearings[:, None] + spread + pose[2]).ravel()
    starts, ways = np.full((len(angles), 3), LEVEL), np.zeros((len(angles), 3))
    starts[:, :2] = np.repeat(transform(np.array(pose), origins), len(spread), axis=0)
    ways[:, 0], ways[:, 1] = np.cos(angles), np.sin(angles)
    seen = cast(scene.world, starts, ways).reshape(len(bearings), -1).min(axis=1)
    seen[seen > laser.reach] = math.inf
    return RangeScan(stamp_ns, origins, bearings, half_angles, delays, seen, 0.02, laser.reach)


@lru_cache(maxsize=32)
def _beams(laser: Mount) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """A sensor's beams, base frame.

    Returns:
        Bearings (n,), rad; origins (n, 2), m; rays over the width of a beam (m,), rad; half angles (n,), rad; time
        offsets (n,), s.
    """
    count = max(1, round(laser.beams * laser.half_field / math.pi))
    turns = (np.arange(count, dtype=np.float64) + 0.5) * (2.0 * laser.half_field / count) - laser.half_field
    bearings: Floats = np.remainder(turns + laser.middle + math.pi, math.tau) - math.pi
    origins = np.stack([laser.x + laser.rim * np.cos(bearings), laser.y + laser.rim * np.sin(bearings)], axis=1)
    spread = np.linspace(-laser.half_angle, laser.half_angle, RAYS if laser.half_angle else 1)
    half_angles, delays = np.full(count, laser.half_angle), np.zeros(count)
    return read_only(bearings), read_only(origins), spread, read_only(half_angles), read_only(delays)


def shrunk(behaviour: Behaviour, make: Maker, scene: Scene, seen: Measured) -> tuple[Scene, Measured]:
    """The smallest scene found that still fails, with obstacles left out, and its result."""
    left = TRIES
    is_smaller = behaviour.shrinks
    while is_smaller and left > 0:
        is_smaller = False
        for candidate in (*scene.smaller(), *_rounded(scene)):
            if left <= 0:
                break
            left -= 1
            try:
                tried = behaviour.measure(make, candidate)
            except Unfit:  # the reduced scene lacks what the measure needs
                continue
            if not tried.holds:
                scene, seen, is_smaller = candidate, tried, True
                break
    return scene, seen


def _rounded(scene: Scene) -> tuple[Scene, ...]:
    """The scene with rounded numbers; empty if they are round already."""
    target = (round(scene.target[0], 1), round(scene.target[1], 1))
    obstacles = tuple(
        one if isinstance(one, Box)
        else replace(one, x=round(one.x, 1), y=round(one.y, 1), radius=max(0.1, round(one.radius, 1)))
        for one in scene.obstacles
    )  # fmt: skip
    rounded = replace(scene, target=target, obstacles=obstacles)
    return () if rounded == scene else (rounded,)
