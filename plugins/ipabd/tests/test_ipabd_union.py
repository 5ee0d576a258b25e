"""The map of Fig. 7: its contents and its faults."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from navloom import Context, MapperInput, Pose2D, PoseTrack, RobotSpec, Sweep
from navloom_ipabd.adapter import Ipabd, Union
from navloom_ipabd.lines import distances_to_segments
from navloom_ipabd.mapping import MapSettings, draw
from navloom_ipabd.rules import Filters, Rule
from navloom_ipabd.track import standing
from navloom_ipabd.union import union_outline

ALL = MapSettings(filters=Filters(z_limit=math.inf))
AT_S = (0.0, 0.0, np.pi / 2)


def cell_at(grid, x: float, y: float) -> int:
    column, row = round(x / 0.4) - grid.lattice.column, round(y / 0.4) - grid.lattice.row
    return int(grid.cells[row, column])


def test_two_pixels_of_one_column_stay_two_points(make_image) -> None:
    """2 m and 5 m straight ahead, at two pitches: both are kept, the nearer one does not hide the other."""
    image = make_image([[2.0], [5.0]], pitches_deg=[0.0, 0.0])
    shown = union_outline(image, standing(2, (1.0, 0.0, 0.0)), ALL)
    assert shown.segments.tolist() == [[3.0, 0.0, 3.0, 0.0], [6.0, 0.0, 6.0, 0.0]]
    assert shown.barriers.seen.tolist() == [5.0]


def test_a_sensor_beside_the_middle_of_the_robot_sees_from_there(make_image) -> None:
    """0.25 m ahead and 0.1 m to the left of a robot at (1, 2) that looks along y; a point 2 m ahead of it."""
    shown = union_outline(make_image([[2.0]], mount=(0.25, 0.1, 0.4)), standing(1, (1.0, 2.0, np.pi / 2)), ALL)
    assert shown.sensor == pytest.approx((0.9, 2.25, np.pi / 2))
    assert shown.segments[0] == pytest.approx([0.9, 4.25, 0.9, 4.25])


def test_every_return_of_the_papers_world_is_kept(paper_sweep) -> None:
    """9494 pixels less the 1801 without a return."""
    counts = union_outline(paper_sweep.image, standing(94, AT_S), ALL).barriers.counts
    assert (counts[Rule.KEPT], counts[Rule.NO_RETURN]) == (7693, 1801)
    assert sum(counts.values()) == 9494


def test_girder_b_closes_its_gate_unless_points_above_the_robot_are_left_out(paper_sweep) -> None:
    low = dataclasses.replace(ALL, filters=Filters(z_limit=1.2))
    grid, below = (
        draw(union_outline(paper_sweep.image, standing(94, AT_S), settings, keeps_floor=False), settings)
        for settings in (ALL, low)
    )
    assert [cell_at(grid, x, 5.2) for x in (2.0, 2.4, 2.8)] == [100, 100, 100]
    assert [cell_at(below, x, 5.2) for x in (2.0, 2.4, 2.8)] == [0, 0, 0]


def test_the_floor_is_in_it_like_a_wall_unless_it_is_left_out(paper_sweep) -> None:
    """The floor is first seen 4.57 m ahead, at -5° from 0.4 m."""
    still = standing(94, AT_S)
    with_floor = draw(union_outline(paper_sweep.image, still, ALL), ALL)
    without = draw(union_outline(paper_sweep.image, still, ALL, keeps_floor=False), ALL)
    assert (cell_at(with_floor, 0.0, 4.8), cell_at(without, 0.0, 4.8)) == (100, 0)


def message_of(image) -> Sweep:
    return Sweep(0, 1, image.ranges, image.pitches, image.frame_times, image.bearings, image.geometry, *image.mount,
                 image.range_min, image.range_max)  # fmt: skip


@pytest.fixture
def context() -> Context:
    corners = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = RobotSpec(corners, 1.2, 0.05, 0.3, 0.5, np.radians(25.0), 0.5, 1.0)
    return Context("main", 0.05, robot, np.random.default_rng, Pose2D(0.0, 0.0, np.pi / 2))


def test_the_plugin_gives_both_girders_where_ipabd_gives_one(paper_sweep, context) -> None:
    track = PoseTrack(np.array([0, 1_300_000_000]), np.array([AT_S, AT_S]))
    given = MapperInput(1_300_000_000, (message_of(paper_sweep.image),), (), track)
    updates = {cls.name: cls(cls.Params(), context).update(given) for cls in (Ipabd, Union)}
    girder_b = np.column_stack([np.linspace(1.6, 3.6, 12), np.full(12, 5.2)])
    assert distances_to_segments(girder_b, updates["ipabd"].segments).min() > 0.15
    assert distances_to_segments(girder_b, updates["union"].segments).max() < 0.4
    assert {count.name: count.value for count in updates["union"].counts}["kept"] == 7693
    assert (updates["union"].grid.cells == 100).sum() > 3 * (updates["ipabd"].grid.cells == 100).sum()
    assert set(np.unique(updates["union"].grid.cells)) == {-1, 0, 100}
