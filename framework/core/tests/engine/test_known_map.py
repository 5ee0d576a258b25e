"""The map that localizers match, beside the map with what the mapper sees: who publishes it and who reads it."""

from __future__ import annotations

from typing import Any

import numpy as np
from navloom.engine.node_ports import Wired
from navloom.engine.nodes.localizer_node import LocalizerNode
from navloom.engine.nodes.mapper_node import MapperNode
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.nodes.planner_node import PlannerNode
from navloom.engine.open_loop_node import FedNode
from navloom.geometry.world import Raster, World
from navloom.messages import (
    MapUpdate,
    Message,
    OccupancyGrid,
    Odometry,
    Path,
    PlanFailure,
    PlanRequest,
    Point2D,
    Pose2D,
    PoseEstimate,
    Twist2D,
)
from navloom.roles import (
    Context,
    Localizer,
    LocalizerInput,
    Mapper,
    MapperInput,
    Params,
    Planner,
    PlannerInput,
    RobotSpec,
)

ORIGIN = Pose2D(0.0, 0.0, 0.0)
STILL = Twist2D(0.0, 0.0, 0.0)
ROBOT = RobotSpec(np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]]), 0.6, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)
CONTEXT = Context("main", 0.05, ROBOT, np.random.default_rng, ORIGIN)


def grid(value: int) -> OccupancyGrid:
    return OccupancyGrid(np.full((1, 1), value, np.int8), 1.0, ORIGIN)


def update(value: int) -> MapUpdate:
    return MapUpdate(0, grid(value), np.empty((0, 4)), ())


KNOWN, SEEN = grid(0), update(100)


def fed(node: Node) -> FedNode:
    return FedNode(type(node).spec(Wired(node.role)), node)


def step(node: FedNode, number: int = 0, **given: Any) -> list[tuple[str, Message]]:
    made = node.step(Tick(number, 0.05 * number, 50_000_000 * number, 0), given)
    assert not node.fault
    return made


class OverKnown(Mapper[Params]):
    """Publishes a map with an obstacle, over a known map that changes in the third step."""

    name = "over_known"
    seen: list[MapperInput]

    def update(self, given: MapperInput) -> MapUpdate | None:
        self.seen = [*getattr(self, "seen", []), given]
        return SEEN

    def known(self) -> OccupancyGrid | None:
        return KNOWN if len(self.seen) < 3 else SEEN.grid


class WithoutKnown(OverKnown):
    name = "without_known"

    def known(self) -> None:
        return None


class Matching(Localizer[Params]):
    name = "matching"
    given: LocalizerInput

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        self.given = given
        return PoseEstimate(given.odometry.stamp_ns, ORIGIN, STILL, np.zeros((3, 3)))


class OnFreeMaps(Planner[Params]):
    """Finds a path on a free map only."""

    name = "on_free_maps"

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        request = given.request
        if given.map.grid.cells.any():
            return PlanFailure(request.request_id, "no_path", Point2D(0.0, 0.0), "closed")
        return Path(request.request_id, np.array([(0.0, 0.0), (0.5, 0.0)]), 0.5, None)


def test_the_known_map_is_published_before_the_first_map_and_whenever_it_is_another() -> None:
    node = fed(MapperNode(OverKnown(Params(), CONTEXT)))
    ports = [[port for port, _ in step(node, number)] for number in range(4)]
    assert ports == [["known", "map"], ["map"], ["known", "map"], ["map"]]


def test_a_mapper_without_a_known_map_publishes_its_map_only() -> None:
    assert [port for port, _ in step(fed(MapperNode(WithoutKnown(Params(), CONTEXT))))] == ["map"]


def test_a_mapper_hears_whether_the_localizer_is_tracking() -> None:
    mapper = OverKnown(Params(), CONTEXT)
    node = fed(MapperNode(mapper))
    for number, state in enumerate(("tracking", "lost")):
        pose = PoseEstimate(50_000_000 * number, ORIGIN, STILL, np.zeros((3, 3)), state)  # type: ignore[arg-type]
        step(node, number, track=[pose])
    assert [given.is_tracking for given in mapper.seen] == [True, False]


def test_a_localizer_gets_the_known_map_instead_of_the_one_with_what_is_seen() -> None:
    localizer = Matching(Params(), CONTEXT)
    node, odometry = fed(LocalizerNode(localizer)), Odometry(0, ORIGIN, STILL)
    step(node, odometry=odometry, map=SEEN, known=KNOWN)
    first = localizer.given.map
    assert first is not None and first.grid is KNOWN and localizer.given.known is KNOWN
    step(node, odometry=odometry, map=SEEN, known=KNOWN)
    assert localizer.given.map is first


def test_a_localizer_gets_the_map_of_a_mapper_without_a_known_one() -> None:
    localizer = Matching(Params(), CONTEXT)
    step(fed(LocalizerNode(localizer)), odometry=Odometry(0, ORIGIN, STILL), map=SEEN)
    assert localizer.given.map is SEEN and localizer.given.known is None


class OnNoMap(Planner[Params]):
    """Calls the goal occupied."""

    name = "on_no_map"

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        goal = given.request.goal
        return PlanFailure(given.request.request_id, "goal_occupied", Point2D(goal.x, goal.y), "in an obstacle")


def test_a_goal_where_the_known_map_is_unknown_is_refused_with_that_reason() -> None:
    # 20 cells of 0.5 m along x: the last ten are unknown; the robot with a cell's margin reaches 0.78 m.
    unknown = np.zeros((20, 20), dtype=np.bool_)
    unknown[:, 10:] = True
    world = World("map", raster=Raster("office.yaml", unknown, 0.5, unknown=unknown))
    node = fed(PlannerNode(OnNoMap(Params(), CONTEXT), 0.3, ROBOT, world))

    def reason(x: float, **given: Any) -> str:
        asked = (PlanRequest(7, ORIGIN, Pose2D(x, 5.0, 0.0)),)
        ((_, failure),) = step(node, plan=asked, map=update(100), **given)
        assert isinstance(failure, PlanFailure) and failure.kind == "goal_occupied"
        return failure.detail

    told = "which counts as an obstacle; office.yaml?unknown=free leaves it free"
    assert reason(8.0, known=update(100).grid) == f"the goal (8.00, 5.00): office.yaml is unknown there, {told}"
    assert reason(4.5, known=update(100).grid) == f"the goal (4.50, 5.00): office.yaml is unknown beside it, {told}"
    assert reason(4.0, known=update(100).grid) == "in an obstacle"
    # Its occupied cells are what the mapper saw.
    assert reason(8.0) == "in an obstacle"


def test_a_planner_that_finds_no_way_past_what_is_seen_also_plans_on_the_known_map() -> None:
    node = fed(PlannerNode(OnFreeMaps(Params(), CONTEXT), 0.3))
    asked = (PlanRequest(7, ORIGIN, Pose2D(0.5, 0.0, 0.0)),)
    made = step(node, plan=asked, map=SEEN, known=KNOWN)
    assert [port for port, _ in made] == ["path", "failure"]
    assert [port for port, _ in step(node, plan=asked, map=update(0), known=KNOWN)] == ["path"]
    assert [port for port, _ in step(node, plan=asked, map=SEEN, known=SEEN.grid)] == ["failure"]
    assert [port for port, _ in step(node, plan=asked, map=SEEN)] == ["failure"]
