"""The defaults of both mappers, value by value: one level frame of a few beams in, map and counts out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Context, InputError, MapperInput, Pose2D, PoseTrack, RobotSpec, Sweep
from navloom_ipabd.adapter import Ipabd, Union

HERE = ((0, 0.0, 0.0, 0.0), (1_000_000_000, 0.0, 0.0, 0.0))
PRINTED = "ipabd@printed"
BOTH = pytest.mark.parametrize("mapper", [Ipabd, PRINTED, Union], ids=["ipabd", PRINTED, "union"])
OUTLINES = pytest.mark.parametrize("mapper", [Ipabd, PRINTED], ids=["ipabd", PRINTED])


def make(mapper=Ipabd, **params):
    """A mapper of a robot 1.2 m high."""
    if mapper == PRINTED:
        mapper, params = Ipabd, Ipabd.presets["printed"].values() | params
    corners = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = RobotSpec(corners, 1.2, 0.05, 0.3, 0.5, math.radians(25.0), 0.5, 1.0)
    context = Context("main", 0.05, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    return mapper(mapper.Params(**params), context)


def seen(mapper, ranges, bearings=None, height=0.4, track=HERE, times=(0.0,), **changes):
    """The map of frames of a laser at a height, m, that looks level along bearings, degrees; default 0, 1, 2, ..."""
    table = np.atleast_2d(np.asarray(ranges, np.float64))
    angles = np.arange(float(table.shape[1])) if bearings is None else np.asarray(bearings, np.float64)
    values = {
        "stamp_ns": 0, "request_id": 1, "ranges": table, "pitches": np.zeros(len(table)),
        "frame_times": np.array(times), "bearings": np.radians(angles), "geometry": "paper",
        "x": 0.0, "y": 0.0, "z": height, "range_min": 0.0, "range_max": 30.0,
    } | changes  # fmt: skip
    poses = PoseTrack(np.array([row[0] for row in track]), np.array([row[1:] for row in track], np.float64))
    return mapper.update(MapperInput(2_000_000_000, (Sweep(**values),), (), poses, False))


def counts(update):
    return {count.name: count.value for count in update.counts if count.value}


@BOTH
def test_points_within_0_06_m_of_the_floor_are_floor(mapper):
    low, high = (counts(seen(make(mapper, **({"keeps_floor": False} if mapper is Union else {})), [2.0], height=z))
                 for z in (0.059, 0.061))  # fmt: skip
    assert (low, high) == ({"floor": 1}, {"kept": 1})


def test_the_union_keeps_the_floor():
    assert counts(seen(make(Union), [2.0], height=0.0)) == {"kept": 1}


@BOTH
def test_ranges_within_0_05_m_of_the_maximum_are_no_returns(mapper):
    assert counts(seen(make(mapper), [29.94, 29.96])) == {"kept": 1, "beyond_max": 1}


@BOTH
def test_the_shortest_range_counts(mapper):
    """There is no limit below that of the sensor."""
    assert counts(seen(make(mapper), [0.02])) == {"kept": 1}


@BOTH
def test_a_track_may_miss_an_end_of_the_sweep_by_0_2_s(mapper):
    late = ((190_000_000, 0.0, 0.0, 0.0), (1_000_000_000, 0.0, 0.0, 0.0))
    assert counts(seen(make(mapper), [2.0], track=late)) == {"kept": 1}
    with pytest.raises(InputError, match="covers"):
        seen(make(mapper), [2.0], track=((210_000_000, 0.0, 0.0, 0.0), *late[1:]))


@BOTH
def test_frames_are_placed_where_the_robot_was(mapper):
    """It drives back from 1 to 0 m while the two frames look at a post 1 and 2 m ahead of it."""
    track = ((0, 1.0, 0.0, 0.0), (1_000_000_000, 0.0, 0.0, 0.0))
    update = seen(make(mapper), [[1.0], [2.0]], track=track, times=(0.0, 1.0))
    assert update.segments[:, 0] == pytest.approx(np.full(len(update.segments), 2.0))


@BOTH
def test_cells_are_0_4_m_wide_along_the_axes_of_the_map(mapper):
    grid = seen(make(mapper), [2.0]).grid
    assert (grid.resolution, grid.origin.heading) == (0.4, 0.0)


def test_both_mappers_take_sweeps_only():
    assert Ipabd.accepts == Union.accepts == (Sweep,)


@BOTH
def test_nothing_farther_than_20_m_is_marked_free(mapper):
    """Of cells of 0.3 m, that whose centre is 19.8 m away is the last."""
    grid = seen(make(mapper, cell=0.3), [29.0, 29.0], bearings=[-0.5, 0.5]).grid
    row = round(-grid.origin.y / 0.3 - 0.5)
    free = np.flatnonzero(grid.cells[row] == 0) - round(-grid.origin.x / 0.3 - 0.5)
    assert (free.min(), free.max()) == (0, 66)


@BOTH
def test_the_map_of_the_last_sweep_is_kept(mapper):
    one = make(mapper)
    first = seen(one, [2.0, 2.0])
    second = seen(one, [3.0, 3.0], bearings=[90.0, 91.0])
    assert first.segments[0].tolist() in second.segments.tolist()


def segments(ranges, mapper=Ipabd, **params):
    """Number of objects that a row of beams one degree apart is parted into; two points make one segment."""
    return len(seen(make(mapper, **params), ranges).segments)


@OUTLINES
def test_an_object_ends_where_the_distance_exceeds_the_adaptive_threshold(mapper):
    """2 sin 1 / sin 9 + 3 * 0.02 = 0.2831 m; 2.27 m is 0.2726 m from 2 m, 2.29 m is 0.2924 m from it."""
    assert (segments([2.0, 2.27], mapper), segments([2.0, 2.29], mapper)) == (1, 2)


def test_near_by_the_noise_decides():
    """0.3 sin 1 / sin 9 + 0.06 = 0.0935 m; 0.392 m is 0.0922 m from it and 0.394 m is 0.0942 m."""
    assert (segments([0.3, 0.392]), segments([0.3, 0.394])) == (1, 2)


def test_dietmayer_allows_0_1_m_more_than_the_chord():
    """0.1 + 2 * 0.017453 = 0.1349 m; 2.128 m is 0.1331 m away, 2.131 m 0.1360 m."""
    assert [segments([2.0, far], segmentation="dietmayer") for far in (2.128, 2.131)] == [1, 2]


def test_santos_takes_15_degrees():
    """0.1 + 0.017453 * 4 tan 15 / (cos 0.5 - sin 0.5) = 0.1189 m; 4.09 m is 0.1144 m away, 4.10 m 0.1226 m."""
    assert [segments([4.0, far], segmentation="santos") for far in (4.09, 4.10)] == [1, 2]


def test_lee_takes_a_ratio_of_0_05():
    """0.2 / 4.2 = 0.0476 and 0.22 / 4.22 = 0.0521."""
    assert [segments([2.0, far], segmentation="lee") for far in (2.2, 2.22)] == [1, 2]


def test_two_columns_may_be_missing_within_an_object():
    inf = math.inf
    assert (segments([2.0, inf, inf, 2.0]), segments([2.0, inf, inf, inf, 2.0])) == (1, 2)


@OUTLINES
def test_lines_are_within_0_06_m_of_their_points(mapper):
    """Points at -4, 0 and 4 degrees, the middle one 0.085 or 0.095 m behind the chord of the others: their line passes
    a third of that behind the chord, so the middle one is 0.0567 or 0.0633 m off it."""
    side = 2.0 / math.cos(math.radians(4.0))
    for deep, count in ((0.085, 1), (0.095, 2)):
        update = seen(make(mapper), [side, 2.0 + deep, side], bearings=[-4.0, 0.0, 4.0])
        assert len(update.segments) == count


def test_the_printed_slope_test_takes_0_8():
    """Walls along x with cell centres at multiples of 0.4 m: |m - x1| <= 0.8 cells. 1.98 m is cell 4.95, so 5 only and
    not 4, 0.95 off; 1.90 m is cell 4.75, so 5 and 4, 0.75 off."""
    for x, columns in ((1.98, [5]), (1.90, [4, 5])):
        far = x / math.cos(math.radians(4.0))
        grid = seen(make(raster="paper"), [far, far], bearings=[-4.0, 4.0]).grid
        start = round(-grid.origin.x / 0.4 - 0.5)
        assert sorted({int(column) - start for _, column in np.argwhere(grid.cells == 100)}) == columns


def test_a_line_occupies_the_cells_whose_centres_it_passes():
    """y = x - 1.12 m is y = x - 2.8 cells: 0.14 cells from the centres (4, 1) to (8, 5), 0.57 from their neighbours."""
    bearings = np.arange(17.0, 34.0, 2.0)
    angles = np.radians(bearings)
    grid = seen(make(), 1.12 / (np.cos(angles) - np.sin(angles)), bearings=bearings).grid
    start = np.round([-grid.origin.y / 0.4 - 0.5, -grid.origin.x / 0.4 - 0.5]).astype(int)
    found = [(int(column), int(row)) for row, column in np.argwhere(grid.cells == 100) - start]
    assert found == [(4, 1), (5, 2), (6, 3), (7, 4), (8, 5)]


@BOTH
@pytest.mark.parametrize(("geometry", "y"), [("paper", 2.0 * math.cos(0.3) * 0.5), ("rigid_pitch", 1.0)])
def test_points_are_placed_as_the_sweep_says(mapper, geometry, y):
    """2 m away, pitched by 0.3 rad, 30 degrees to the left: y = R cos(alpha) sin(beta), or R sin(beta)."""
    update = seen(make(mapper), [2.0], bearings=[30.0], pitches=np.array([0.3]), geometry=geometry)
    assert update.segments[0, 1] == pytest.approx(math.cos(0.3) if mapper == PRINTED else y)


@OUTLINES
def test_a_wall_behind_visible_floor_is_kept(mapper):
    """The laser looks down to the floor 1 m away, and level to a wall 3 m away."""
    update = seen(
        make(mapper), [[math.hypot(1.0, 0.4)], [3.0]], pitches=np.array([-math.atan(0.4), 0.0]), times=(0.0, 0.5)
    )
    assert counts(update) == {"floor": 1, "kept": 1}
