import math

import pytest
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import rectangle
from navloom.geometry.solids import overlaps
from navloom.geometry.world import Box, Place, World
from navloom.worlds import WORLDS
from navloom.worlds.paper_world import (
    paper_gates,
    paper_gates_blocked_b,
    paper_gates_blocked_bc,
    paper_gates_obstacle,
    paper_gates_open_a,
)

TABLE = {
    "back wall": ((-4.6, 7.2), (9.2, 9.4), (0.0, 2.4)),
    "left wall": ((-4.4, -4.2), (-1.0, 9.4), (0.0, 2.4)),
    "right wall": ((6.8, 7.0), (-1.0, 9.4), (0.0, 2.4)),
    "gate wall left": ((-4.4, -1.4), (5.2, 5.4), (0.0, 2.4)),
    "girder A": ((-1.4, 1.0), (5.2, 5.4), (0.9, 1.1)),
    "post A/B": ((1.0, 1.4), (5.2, 5.4), (0.0, 2.4)),
    "girder B": ((1.4, 3.8), (5.2, 5.4), (1.4, 1.6)),
    "partition": ((3.8, 4.2), (5.2, 6.8), (0.0, 2.4)),
    "ceiling": ((-4.4, 7.0), (-1.0, 9.4), (2.4, 2.5)),
}
ROBOT = rectangle(0.8, 0.8)


def boxes_of(world: World) -> dict[str, Box]:
    return {o.name: o for o in world.obstacles if isinstance(o, Box)}


def test_the_world_has_the_boxes_of_the_table() -> None:
    world = paper_gates()
    assert {name: (box.x, box.y, box.z) for name, box in boxes_of(world).items()} == TABLE
    assert world.start == Place(0.0, 0.0, math.pi / 2)
    assert world.goal == Place(0.0, 7.6)


def test_the_variants_differ_in_one_thing_each() -> None:
    names = set(TABLE)
    assert set(boxes_of(paper_gates_open_a())) == names - {"girder A"}
    assert set(boxes_of(paper_gates_blocked_b())) == names | {"barrier B"}
    assert set(boxes_of(paper_gates_blocked_bc())) == names | {"barrier B", "door C"}
    assert set(boxes_of(paper_gates_obstacle())) == names | {"obstacle O"}


def test_the_barrier_leaves_less_than_the_robots_width_and_the_door_fills_the_corridor() -> None:
    boxes = boxes_of(paper_gates_blocked_bc())
    gate, barrier = TABLE["girder B"][0], boxes["barrier B"].x
    assert barrier[0] - gate[0] == pytest.approx(0.7) and gate[1] - barrier[1] == pytest.approx(0.7)
    assert boxes["door C"].x == (TABLE["partition"][0][1], TABLE["right wall"][0][0])


def test_obstacle_o_is_on_the_way_only_after_the_sweep() -> None:
    world = paper_gates_obstacle()
    assert boxes_of(world)["obstacle O"].centre == pytest.approx((1.2, 2.6))
    assert clearance(ROBOT, Place(1.2, 2.6), world, height=1.2, time=100.0)[0] > 0.0
    assert clearance(ROBOT, Place(1.2, 2.6), world, height=1.2, sweep_ended=True) == (0.0, "obstacle O")


def test_a_robot_of_1_2_m_is_stopped_by_girder_a_and_passes_below_girder_b() -> None:
    assert clearance(ROBOT, Place(0.0, 5.3), paper_gates(), height=1.2) == (0.0, "girder A")
    assert not overlaps(TABLE["girder B"][2], (0.0, 1.2))
    distance, name = clearance(ROBOT, Place(2.6, 5.3), paper_gates(), height=1.2)
    # Gate B is 2.4 m wide: 0.8 m on each side of the robot.
    assert distance == pytest.approx(0.8)
    assert name in ("post A/B", "partition")


@pytest.mark.parametrize("name", WORLDS)
def test_every_named_world_has_a_free_start_and_goal_within_its_bounds(name: str) -> None:
    world = WORLDS[name]()
    assert world.name == name
    x0, y0, x1, y1 = world.bounds
    for place in (world.start, world.goal):
        assert place is not None
        assert x0 < place.x < x1
        assert y0 < place.y < y1
        assert clearance(ROBOT, place, world, height=1.2)[0] > 0.1
