"""Builders and scenes of `navloom.testing`."""

import math

import numpy as np
import pytest
from navloom import Avoidance, Avoider, Box, Cylinder, Extra, GateStatus, Params, Place, Raster, Twist2D, World
from navloom.testing import (
    avoider_input,
    box,
    cast,
    closed,
    controller_input,
    corridor,
    grid,
    localizer_input,
    make,
    mapper_input,
    planner_input,
    recovery_input,
    scan,
    sweep,
    wall_ahead,
)


class Careful(Avoider):
    """Stops where anything ahead is near."""

    name = "careful"

    class Params(Params):
        distance: float = 0.5

    def avoid(self, given):
        nearest = min((one.ranges.min() for one in given.scans), default=math.inf)
        return Avoidance(Twist2D(0.0 if nearest < self.params.distance else 0.3, 0.0, 0.0), "steering")


def test_a_unit_test_of_an_avoider_is_five_lines():
    avoider = make(Careful, distance=0.6)
    assert avoider.avoid(avoider_input(scan(wall_ahead(0.4)))).twist.vx == 0.0
    assert avoider.avoid(avoider_input(scan(wall_ahead(0.8)))).twist.vx == 0.3


def test_a_scan_of_a_world_is_that_of_geometry():
    seen = scan(wall_ahead(2.0), beams=3, field_of_view=math.radians(90.0))
    assert seen.ranges == pytest.approx([2.0 * math.sqrt(2.0), 2.0, 2.0 * math.sqrt(2.0)])
    moved = scan(wall_ahead(2.0), at=(0.5, 0.0, math.radians(60.0)), beams=1)
    assert moved.ranges == pytest.approx([1.5 / math.cos(math.radians(60.0))])
    mounted = scan(wall_ahead(2.0), beams=1, mount=(0.2, 0.1, 0.0))
    assert mounted.ranges == pytest.approx([1.8]) and mounted.origins.tolist() == [[0.2, 0.1]]


def test_a_ray_along_a_wall_does_not_meet_it():
    assert scan(wall_ahead(2.0, width=2.0), at=(0.0, 5.0), beams=1).ranges.tolist() == [math.inf]
    assert scan(corridor(2.0), beams=1).ranges.tolist() == [math.inf]


def test_a_sweep_meets_wall_and_floor():
    seen = sweep(wall_ahead(2.0), frames=2, beams=1, pitches=(math.radians(-30.0), 0.0), height=0.5)
    assert seen.ranges[:, 0] == pytest.approx([0.5 / math.sin(math.radians(30.0)), 2.0])


def test_scenes_have_the_stated_width():
    assert scan(closed(0.8), beams=4, field_of_view=math.radians(270.0)).ranges[1:3] == pytest.approx(
        [0.8 / math.cos(math.radians(45.0))] * 2
    )
    side = scan(corridor(2.4), at=(0.0, 0.0, math.radians(90.0)), beams=1)
    assert side.ranges == pytest.approx([1.2])
    cells = grid(box(2.0, 0.0, 0.4), 0.1).cells
    assert np.count_nonzero(cells == 100) == 16


def test_every_role_has_an_input_of_one_line():
    assert mapper_input(scan(), sweep()).sweep_sensors == ("sensor0",)
    assert planner_input(corridor(), goal=(4.0, 0.0), request_id=3).request.request_id == 3
    assert localizer_input(scan(), odometry=(1.0, 0.0)).odometry.pose.x == 1.0
    assert recovery_input(trail=[(0.0, 0.0), (0.1, 0.0)]).trail.shape == (2, 3)
    on = controller_input((1.0, 0.2)).reference
    assert (on.progress, on.cross_track, on.speed) == pytest.approx((1.0, 0.2, 0.3))


def test_a_scan_sees_the_cells_of_a_raster_in_its_own_frame():
    cells = np.zeros((20, 40), dtype=bool)
    cells[:, 30] = True
    # Cells of 0.1 m from (-1, -1) on: the column of walls begins at x = -1 + 3 = 2.
    world = World("raster", raster=Raster("wall", cells, 0.1, Place(-1.0, -1.0)))
    assert scan(world, beams=3, field_of_view=math.pi).ranges == pytest.approx([math.inf, 2.0, math.inf])
    assert scan(world, (0.0, 0.0, 0.4), beams=1).ranges[0] == pytest.approx(2.0 / math.cos(0.4))
    assert scan(world, (3.0, 0.0, math.pi), beams=1).ranges[0] == pytest.approx(0.9)
    turned = World("raster", raster=Raster("wall", cells, 0.1, Place(1.0, -1.0, 0.5 * math.pi)))
    assert scan(turned, (0.0, 0.0, 0.5 * math.pi), beams=1).ranges[0] == pytest.approx(2.0)
    above = World("raster", raster=Raster("girder", cells, 0.1, Place(-1.0, -1.0), (1.0, 2.0)))
    assert scan(above, beams=1).ranges[0] == math.inf


def test_a_scan_sees_an_obstacle_where_it_is_at_its_stamp():
    way = ((0.0, 2.0, 0.0), (10.0, 4.0, 0.0))
    world = World(
        "moving", (Cylinder("cart", 9.0, 0.0, 0.5, waypoints=way), Box("late", (1.0, 2.0), (-1, 1), appears_at=6))
    )
    seen = [scan(world, beams=1, stamp=stamp).ranges[0] for stamp in (0.0, 5.0, 7.0)]
    assert seen == pytest.approx([1.5, 2.5, 1.0])


def test_a_ray_touches_the_faces_that_it_runs_along_and_misses_what_lies_beside_it():
    world = World("boxes", (Box("left", (2.0, 3.0), (0.0, 1.0)), Box("right", (5.0, 6.0), (-1.0, 0.0), (0.0, 0.2))))
    starts = np.array([[0.0, y, 0.2] for y in (-1e-9, 0.0, 1.0, 1.0 + 1e-9)])
    assert cast(world, starts, np.tile([1.0, 0.0, 0.0], (4, 1))) == pytest.approx([5.0, 2.0, 2.0, math.inf])


def test_a_ray_meets_a_turned_box_and_a_cylinder_from_outside_and_from_within():
    turned = Box("turned", (1.0, 3.0), (-1.0, 1.0), yaw=0.25 * math.pi)
    world = World("both", (turned, Cylinder("post", -2.0, 0.0, 0.5, (0.0, 1.0))))
    # The corner of the square is sqrt(2) m from its centre at x = 2; the third ray starts in the post.
    starts = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [-2.0, 0.0, 0.5]])
    ways = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert cast(world, starts, ways) == pytest.approx([2.0 - math.sqrt(2.0), 1.5, 0.0])


def test_an_extra_input_that_a_step_does_not_have_names_what_to_do():
    class Shy(Avoider):
        name = "shy"
        gate = Extra(GateStatus)

        def avoid(self, given):
            return given.extra[self.gate]

    with pytest.raises(KeyError) as raised:
        make(Shy).avoid(avoider_input())
    assert "gate = Extra(GateStatus); a unit test gives it with the input, extra=extras(gate=" in str(raised.value)
