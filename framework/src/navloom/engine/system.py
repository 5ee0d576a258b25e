"""A checked robot: its config, world, graph, parts and sensors, before and after its plugins are made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from navloom.config import Loaded
from navloom.config.schema import Config
from navloom.config.tables import PlaceTable
from navloom.engine.catalogue import Catalogue
from navloom.engine.parts import Part
from navloom.engine.ports import NodeSpec
from navloom.geometry.world import World
from navloom.messages import OccupancyGrid, Pose2D
from navloom.roles import ROLES, RobotSpec, Role, SensorSpec

__all__ = ["System"]


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
