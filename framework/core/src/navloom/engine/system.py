"""The robot of a checked config: world, graph, parts and sensors, before and after its plugins are made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from navloom.config import Loaded
from navloom.config.schema import Config
from navloom.config.tables import LOOKING_TIMEOUT, STANDING_TIMEOUT, PlaceTable
from navloom.engine.catalogue import Catalogue
from navloom.engine.node_ports import NodeSpec
from navloom.engine.plugin_instances import Part
from navloom.geometry.world import World
from navloom.messages import OccupancyGrid, Pose2D
from navloom.navigation.braking import Braking
from navloom.roles import ANYWHERE, ROLES, Localizer, Recovery, RobotSpec, Role, SensorSpec

__all__ = ["System"]


@dataclass(eq=False)
class System:
    """Everything of a run except the executor.

    Attributes:
        loaded: The config.
        robot: Description of the robot that plugins receive.
        world: Ground truth, or None on a real robot.
        start: Start pose that the robot believes in, map frame.
        start_sigma: How sure that is, see `Context.start_sigma`.
        true_start: True start pose of a simulated robot, map frame.
        goal: Goal of the config or world, or None.
        goal_tolerance: How near to the goal the robot must come, m.
        catalogue: Its nodes and their declared streams.
        specs: Nodes in the order they step, each with the inputs of all its instances.
        wiring: Wiring of each instance, by role and name.
        parts: Plugins by (role, instance), active ones first.
        sensors: Sensors of the config.
        scans_on_request: The active mapper depends on sweeps that must be requested.
        map: The known map; None if the run has none.
        map_world: The world that it was made from.
        absent: In a replay: active instance, by node, of recorded nodes that are not installed here.
    """

    loaded: Loaded
    robot: RobotSpec
    world: World | None
    start: Pose2D
    start_sigma: tuple[float, float] | None
    true_start: Pose2D
    goal: PlaceTable | None
    goal_tolerance: float
    catalogue: Catalogue
    specs: list[NodeSpec]
    wiring: dict[tuple[str, str], NodeSpec]
    parts: dict[tuple[str, str], Part]
    sensors: tuple[SensorSpec, ...]
    scans_on_request: bool
    map: OccupancyGrid | None = field(default=None)
    map_world: World | None = field(default=None)
    absent: Mapping[str, str] = field(default_factory=dict)

    @property
    def time_limit(self) -> float:
        """Run time at which a run ends, s: the shorter one of the config's and the world's limit."""
        authored = self.world.time_limit if self.world is not None else None
        stop_after = self.config.run.stop_after
        # Results of a world are comparable only within the time that its author gave.
        return stop_after if authored is None else min(stop_after, authored)

    @property
    def longest_run(self) -> int:
        """Most ticks of a run: up to its time limit, and until a robot that then drives stands."""
        return math.ceil(round((self.time_limit + 2.0 * self.braking.patience) / self.config.run.period, 6)) + 2

    @property
    def braking(self) -> Braking:
        """How the robot comes to rest."""
        return Braking(self.robot, self.config.run.period)

    @property
    def drawn_start(self) -> Pose2D:
        """The start for pictures: the one that the robot believes in, or the true one if its start is unknown."""
        return self.true_start if self.start_sigma == ANYWHERE else self.start

    @property
    def searchers(self) -> set[tuple[str, str]]:
        """Localizers that can search and recoveries that look around, by role and name."""
        return {
            source
            for source, part in self.parts.items()
            if (issubclass(part.cls, Localizer) and part.cls.can_search)
            or (issubclass(part.cls, Recovery) and part.cls.looks_around)
        }

    @property
    def localizer_timeout(self) -> float:
        """How long a goal waits for a localizer that is not tracking, s; by default longer if the robot looks around.

        A robot that stands sees no more after some seconds than before.
        """
        given = self.config.navigation.localizer_timeout
        if given is not None:
            return given
        active = {(role, self.config.role_table(role).instance) for role in ("localizer", "recovery")}
        return LOOKING_TIMEOUT if active <= self.searchers else STANDING_TIMEOUT

    @property
    def config(self) -> Config:
        """The checked config."""
        return self.loaded.config

    @property
    def may_wait(self) -> list[tuple[str, str]]:
        """Role instances that step before the gate and may have to wait for the first message of an input."""
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
