import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom.geometry.collision import clearance, overlap_depth, unknown_remedy
from navloom.geometry.footprints import rectangle
from navloom.geometry.frames import transform
from navloom.geometry.world import Box, Cylinder, Place, Raster, World

SQUARE = rectangle(0.8, 0.8)
ORIGIN = Place(0.0, 0.0)


def test_an_empty_world_has_no_nearest_obstacle() -> None:
    assert clearance(SQUARE, ORIGIN, World("empty"), height=1.2) == (math.inf, None)


def test_the_nearest_of_two_is_named() -> None:
    world = World("two", (Box("wall", (2.0, 2.2), (-5.0, 5.0)), Cylinder("post", 0.0, 1.5, 0.1)))
    distance, name = clearance(SQUARE, ORIGIN, world, height=1.2)
    assert (distance, name) == (pytest.approx(1.0), "post")


def test_a_corner_to_a_corner_is_a_diagonal() -> None:
    world = World("corner", (Box("crate", (0.7, 1.0), (0.8, 1.0)),))
    assert clearance(SQUARE, ORIGIN, world, height=1.2)[0] == pytest.approx(0.5)


def test_a_turned_box_is_nearest_with_its_corner() -> None:
    world = World("turned", (Box("crate", (1.0, 3.0), (-1.0, 1.0), yaw=math.pi / 4),))
    assert clearance(SQUARE, ORIGIN, world, height=1.2)[0] == pytest.approx(2.0 - math.sqrt(2.0) - 0.4)


@pytest.mark.parametrize("x", [0.4, 0.3, -0.1])
def test_touching_and_overlapping_are_zero(x: float) -> None:
    world = World("touch", (Box("wall", (x, 2.0), (-0.1, 0.1)),))
    assert clearance(SQUARE, ORIGIN, world, height=1.2) == (0.0, "wall")


def test_a_box_round_the_whole_robot_overlaps_it() -> None:
    world = World("around", (Box("block", (-5.0, 5.0), (-5.0, 5.0)), Cylinder("tank", 0.0, 0.0, 5.0)))
    assert clearance(SQUARE, ORIGIN, world, height=1.2) == (0.0, "block")


@pytest.mark.parametrize(("z", "distance"), [((1.2, 2.4), math.inf), ((1.19, 2.4), 0.6), ((-1.0, 0.0), math.inf)])
def test_only_what_reaches_into_the_height_counts(z: tuple[float, float], distance: float) -> None:
    world = World("girder", (Box("girder", (1.0, 1.2), (-1.0, 1.0), z),))
    assert clearance(SQUARE, ORIGIN, world, height=1.2)[0] == pytest.approx(distance)


def test_an_obstacle_counts_from_when_it_appears() -> None:
    world = World("late", (Box("late", (1.0, 1.2), (-1.0, 1.0), appears_at=5.0),))
    assert clearance(SQUARE, ORIGIN, world, height=1.2, time=4.9)[1] is None
    assert clearance(SQUARE, ORIGIN, world, height=1.2, time=5.0)[1] == "late"
    world = World("swept", (Cylinder("O", 1.0, 0.0, 0.1, appears_after_sweep=True),))
    assert clearance(SQUARE, ORIGIN, world, height=1.2, time=9.0)[1] is None
    assert clearance(SQUARE, ORIGIN, world, height=1.2, sweep_ended=True)[1] == "O"


def test_a_moving_obstacle_is_where_its_waypoints_say() -> None:
    walker = Cylinder("walker", 9.0, 9.0, 0.1, waypoints=((0.0, 3.0, 0.0), (2.0, 1.0, 0.0)))
    assert clearance(SQUARE, ORIGIN, World("walk", (walker,)), height=1.2, time=1.0)[0] == pytest.approx(1.5)


def test_the_nearest_cell_of_a_turned_raster_counts() -> None:
    cells = np.zeros((40, 60), dtype=np.bool_)
    cells[0, 30] = cells[39, 59] = True
    # The raster's x axis is the map's y axis: cell (0, 30) covers x -0.1..0, y 3.0..3.1 of the map.
    world = World("map", raster=Raster("office", cells, 0.1, Place(0.0, 0.0, math.pi / 2)))
    assert clearance(SQUARE, ORIGIN, world, height=1.2) == (pytest.approx(2.6), "office")
    # Cell (39, 59) covers x -4.0..-3.9, y 5.9..6.0.
    assert clearance(SQUARE, Place(-50.0, 0.0), world, height=1.2)[0] == pytest.approx(math.hypot(45.6, 5.5))


def test_a_robot_off_an_empty_raster_meets_nothing() -> None:
    world = World("map", raster=Raster("office", np.zeros((4, 4), dtype=np.bool_), 0.1))
    assert clearance(SQUARE, Place(30.0, 40.0), world, height=1.2)[0] == math.inf


def test_a_pose_in_unknown_cells_or_beside_nothing_else_is_told_from_one_in_an_obstacle() -> None:
    # Columns 0 and 19 are walls, columns 10 to 18 are unknown; the square reaches 0.5 m from its middle.
    occupied, unknown = np.zeros((10, 20), dtype=np.bool_), np.zeros((10, 20), dtype=np.bool_)
    occupied[:, 0] = occupied[:, 10:] = unknown[:, 10:19] = True
    world = World("map", raster=Raster("office.yaml", occupied, 0.25, unknown=unknown))

    def remedy(x: float) -> str:
        return unknown_remedy(SQUARE, Place(x, 1.25), world, height=1.2)

    told = "which counts as an obstacle; office.yaml?unknown=free leaves it free"
    assert (remedy(2.1), remedy(3.0)) == (
        f"office.yaml is unknown beside it, {told}",
        f"office.yaml is unknown there, {told}",
    )
    assert remedy(4.6) == "office.yaml is unknown there, which counts as an obstacle, and a known obstacle is beside it"
    assert remedy(1.25) == remedy(0.6) == remedy(4.9) == ""


PLACES = st.builds(Place, st.floats(-2, 2), st.floats(-2, 2), st.floats(-4, 4))


@settings(deadline=None, max_examples=60)
@given(PLACES, st.floats(-3, 3), st.floats(0.1, 1.0), st.floats(0.1, 1.0))
def test_a_box_is_as_far_as_the_nearest_of_its_points(pose: Place, yaw: float, wide: float, deep: float) -> None:
    """Compared with 161 x 161 points of the box; every point of it is within half a mesh diagonal of one of them."""
    box = Box("box", (0.5, 0.5 + wide), (0.3, 0.3 + deep), yaw=yaw)
    distance, _ = clearance(SQUARE, pose, World("one", (box,)), height=1.2)
    u, v = np.meshgrid(np.linspace(-wide / 2, wide / 2, 161), np.linspace(-deep / 2, deep / 2, 161))
    points = transform((0.5 + wide / 2, 0.3 + deep / 2, yaw), np.stack([u.ravel(), v.ravel()], axis=-1))
    gap = points - (pose.x, pose.y)
    ahead = np.abs(gap @ (math.cos(pose.heading), math.sin(pose.heading))) - 0.4
    aside = np.abs(gap @ (-math.sin(pose.heading), math.cos(pose.heading))) - 0.4
    sampled = np.hypot(np.maximum(ahead, 0.0), np.maximum(aside, 0.0)).min()
    assert distance <= sampled + 1e-9
    assert distance >= sampled - math.hypot(wide, deep) / 320 - 1e-9


@settings(deadline=None, max_examples=30)
@given(PLACES, st.integers(0, 2**32))
def test_raster_cells_are_as_far_as_boxes_in_their_place(pose: Place, seed: int) -> None:
    cells = np.random.default_rng(seed).random((12, 9)) < 0.05
    raster = Raster("cells", cells, 0.25, Place(-1.0, 0.5, 0.7))
    boxes = []
    for row, col in np.argwhere(cells).tolist():
        x, y = transform((-1.0, 0.5, 0.7), ((col + 0.5) * 0.25, (row + 0.5) * 0.25)).tolist()
        boxes.append(Box("cells", (x - 0.125, x + 0.125), (y - 0.125, y + 0.125), yaw=0.7))
    as_boxes, _ = clearance(SQUARE, pose, World("boxes", tuple(boxes)), height=1.2)
    as_cells, _ = clearance(SQUARE, pose, World("cells", raster=raster), height=1.2)
    assert as_cells == pytest.approx(as_boxes, abs=1e-9)


# --- depth of an overlap ---------------------------------------------------------------------------------------------

SLIM = rectangle(0.8, 0.4)
BOX = Box("box", (1.0, 2.0), (-1.0, 1.0))
MAST = Cylinder("mast", 0.0, 5.0, 0.1)
PERSON = Cylinder("person", 0.0, 0.0, 0.2, waypoints=((0.0, 9.0, 0.0), (10.0, -1.0, 0.0)))
HALL = World("hall", (BOX, MAST, PERSON))


@pytest.mark.parametrize(
    ("pose", "name", "time", "depth"),
    [
        (Place(0.65, 0.0), "box", 0.0, 0.05),
        (Place(0.6, 0.0), "box", 0.0, 0.0),
        (Place(0.4, 0.0), "box", 0.0, 0.0),
        (Place(0.65, 0.0), "mast", 0.0, 0.0),
        (Place(0.65, 0.0), "elsewhere", 0.0, 0.0),
        (Place(1.5, -1.15), "box", 0.0, 0.05),
        (Place(1.0 - 0.2 * math.sqrt(5.0) + 0.03, 0.0, -math.atan2(0.2, 0.4)), "box", 0.0, 0.03),
        (Place(0.0, 4.75), "mast", 0.0, 0.05),
        (Place(0.0, 5.0), "mast", 0.0, 0.3),
        (Place(0.45, 5.0), "mast", 0.0, 0.05),
        (Place(0.4 + 0.06, 5.2 + 0.06), "mast", 0.0, 0.1 - 0.06 * math.sqrt(2.0)),
        (Place(0.0, 0.0), "person", 8.5, 0.1),
        (Place(0.0, 0.0), "person", 8.0, 0.0),
    ],
    ids=["front", "touching", "apart", "another", "unknown", "below", "turned", "side", "middle", "end", "corner",
         "met", "not_yet"],
)  # fmt: skip
def test_depth_is_the_shortest_way_out(pose: Place, name: str, time: float, depth: float) -> None:
    assert overlap_depth(SLIM, pose, HALL, name, time) == pytest.approx(depth, abs=1e-12)


def test_a_raster_tells_the_depth_in_one_cell() -> None:
    cells = np.zeros((10, 20), dtype=np.bool_)
    cells[5, 10:] = True
    world = World("walled", raster=Raster("walls", cells, 0.1, Place(2.0, 1.0, math.pi / 2)))
    # The wall's end is at 1.0 m along the raster's x, which is the map's y: at y = 2 m, x = 1.4 to 1.5 m.
    for x, y, depth in ((1.45, 1.57, 0.0), (1.45, 1.63, 0.03), (1.45, 1.8, 0.1), (5.0, 5.0, 0.0)):
        assert overlap_depth(SLIM, Place(x, y, math.pi / 2), world, "walls") >= depth - 1e-12
        assert (depth == 0.0) == (overlap_depth(SLIM, Place(x, y, math.pi / 2), world, "walls") == 0.0)
    assert overlap_depth(SLIM, Place(1.45, 1.63, math.pi / 2), world, "walls") == pytest.approx(0.03)


def test_there_is_a_depth_exactly_where_the_clearance_is_zero() -> None:
    rng = np.random.default_rng(5)
    met = 0
    for x, y, heading in rng.uniform((0.0, -2.0, -3.0), (3.0, 2.0, 3.0), (200, 3)).tolist():
        pose = Place(x, y, heading)
        gap, _ = clearance(SLIM, pose, World("hall", (BOX,)), height=1.0)
        depth = overlap_depth(SLIM, pose, HALL, "box")
        assert (gap == 0.0) == (depth > 0.0)
        met += depth > 0.0
    assert 40 < met < 160
