"""Paths of the whole planner: free of contact, drivable, and failures that name the cause."""

import math

import numpy as np
import pytest
from navloom_astar.grids import RasterMap
from navloom_astar.planning import GoalOccupied, NoPath, OutsideMap, StartOccupied
from navloom_hybrid_astar.clearance import body_of, ground_of, is_free
from navloom_hybrid_astar.flood import distances_to
from navloom_hybrid_astar.motion import cost_of, poses_after
from navloom_hybrid_astar.planning import Driven, HybridPlanner, Settings, sampled
from navloom_hybrid_astar.smoothing import merged, split

BAR = np.array([(0.6, -0.2), (0.6, 0.2), (-0.6, 0.2), (-0.6, -0.2)])
CAR = np.array([(0.75, -0.25), (0.75, 0.25), (-0.2, 0.25), (-0.2, -0.25)])
CELL = 0.05
NONE = np.empty((0, 4))


def room(width=6.0, height=4.0):
    cells = np.zeros((round(height / CELL), round(width / CELL)), dtype=np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    return cells


def planned(cells, start, goal, heading=0.0, outline=CAR, origin=(0.0, 0.0, 0.0), segments=NONE, **settings):
    planner = HybridPlanner(Settings(**({"radius": 0.8} | settings)), outline)
    return planner.plan(start, goal, heading, segments, RasterMap(cells, CELL, origin))


def free_throughout(answer, cells, outline):
    """Whether the footprint, not grown, is clear at poses between those of the path."""
    ground = ground_of(cells >= 50)
    _, work, inner, around, step = body_of(outline, 0.0, CELL)
    exact = (outline / CELL, work, inner, around, step)
    for n in range(len(answer.points) - 1):
        turn = math.remainder(answer.headings[n + 1] - answer.headings[n], math.tau)
        for share in np.linspace(0.0, 1.0, 12):
            x, y = (answer.points[n] + share * (answer.points[n + 1] - answer.points[n])) / CELL
            if not is_free(x, y, answer.headings[n] + share * turn, ground, exact):
                return False
    return True


def ways(answer):
    """1 for each segment forwards, -1 backwards."""
    steps = np.diff(answer.points, axis=0)
    moved = np.hypot(*steps.T) > 1e-9
    return np.sign(
        (steps[moved] * np.stack([np.cos(answer.headings), np.sin(answer.headings)], axis=1)[:-1][moved]).sum(axis=1)
    )


def curvatures(answer):
    """Heading change per length of each segment that has one, 1/m."""
    away = np.hypot(*np.diff(answer.points, axis=0).T)
    turns = (np.diff(answer.headings) + math.pi) % math.tau - math.pi
    moved = away > 1e-6
    return np.abs(turns[moved] / (away[moved] / np.sinc(turns[moved] / math.tau)))


def divided():
    """A room with a wall that leaves a gap of 1.2 m at its upper end."""
    cells = room()
    cells[: cells.shape[0] - 25, 58:62] = 100
    return cells


def test_a_free_straight_way_is_a_straight_line():
    answer = planned(room(), (1.0, 2.0, 0.0), (5.0, 2.0))
    assert answer.length == pytest.approx(4.0)
    assert (answer.headings == 0.0).all()


@pytest.mark.parametrize("outline", [BAR, CAR], ids=["bar", "car"])
@pytest.mark.parametrize("turn", [math.inf, 0.3])
def test_a_path_round_a_wall_has_no_contact(outline, turn):
    cells = divided()
    answer = planned(cells, (1.2, 1.0, 0.0), (4.8, 1.0), 0.0, outline, turn=turn)
    assert isinstance(answer, Driven)
    assert free_throughout(answer, cells, outline)


def test_the_curvature_stays_within_the_radius():
    answer = planned(divided(), (1.2, 1.0, 0.0), (4.8, 1.0), 0.0)
    assert curvatures(answer).max() <= 1.0 / 0.8 + 1e-6


def test_ends_are_the_poses_that_were_asked_for():
    answer = planned(divided(), (1.2, 1.0, 0.3), (4.8, 1.0), -1.2)
    assert [*answer.points[0], answer.headings[0]] == pytest.approx([1.2, 1.0, 0.3])
    assert [*answer.points[-1], answer.headings[-1]] == pytest.approx([4.8, 1.0, -1.2])


def test_a_car_parks_backwards():
    # A bay of 1.4 m depth and 0.9 m width, in which it is to stand with its front to the open side.
    cells = room(6.0, 4.0)
    cells[:28, :50], cells[:28, 68:] = 100, 100
    answer = planned(cells, (1.5, 2.6, 0.0), (2.95, 0.5), math.pi / 2)
    assert isinstance(answer, Driven)
    assert free_throughout(answer, cells, CAR)
    assert ways(answer)[-1] == -1.0


def test_without_reversing_no_segment_leads_backwards():
    answer = planned(room(8.0, 8.0), (4.0, 4.0, 0.0), (3.0, 4.0), 0.0, backwards=False)
    assert (ways(answer) == 1.0).all()


def test_a_reverse_cost_turns_a_long_way_back_into_a_way_forwards():
    cheap, dear = (planned(room(14.0, 6.0), (12.0, 3.0, 0.0), (2.0, 3.0), math.pi, reverse=cost) for cost in (0.0, 2.0))
    assert (ways(cheap) < 0.0).sum() > (ways(dear) < 0.0).sum()


def test_a_robot_that_turns_in_place_does_so_where_its_body_has_room():
    answer = planned(room(), (2.0, 2.0, 0.0), (2.0, 2.0), math.pi, BAR, radius=0.5, turn=0.1)
    assert answer.length == pytest.approx(0.0)
    assert len(answer.points) >= 9  # at most 20 degrees between two


def test_a_long_robot_does_not_turn_in_a_corridor_that_is_narrower_than_it_is_long():
    cells = room(8.0, 0.9)
    assert isinstance(planned(cells, (2.0, 0.45, 0.0), (6.0, 0.45), 0.0, BAR, radius=0.5, turn=0.1), Driven)
    assert isinstance(planned(cells, (2.0, 0.45, 0.0), (6.0, 0.45), math.pi, BAR, radius=0.5, turn=0.1), NoPath)


def test_any_heading_will_do_where_none_is_asked_for():
    answer = planned(room(), (1.0, 2.0, 0.0), (4.0, 2.0), None)
    assert answer.length == pytest.approx(3.0)


def test_a_goal_that_is_walled_in_is_refused_without_an_expansion():
    cells = room()
    cells[:, 60] = 100
    answer = planned(cells, (1.2, 2.0, 0.0), (4.8, 2.0))
    assert isinstance(answer, NoPath)
    assert "no way is wide enough" in answer.detail
    assert answer.place[0] < 3.0


def test_the_bound_of_expansions_ends_the_search():
    answer = planned(divided(), (1.2, 1.0, 0.0), (4.8, 1.0), 0.0, most=3)
    assert isinstance(answer, NoPath)
    assert "3 expansions" in answer.detail


def test_clearance_is_kept_where_there_is_a_path_with_it():
    cells = divided()
    near, far = (planned(cells, (1.2, 1.0, 0.0), (4.8, 1.0), clearance=gap) for gap in (0.0, 0.1))
    grown_car = CAR + 0.09 * np.sign(CAR)
    assert not free_throughout(near, cells, grown_car)
    assert free_throughout(far, cells, grown_car)


def test_a_passage_without_clearance_is_used_if_there_is_no_other():
    cells = room(6.0, 0.65)  # 0.55 m are free, the car is 0.5 m wide
    assert isinstance(planned(cells, (1.0, 0.325, 0.0), (4.0, 0.325), clearance=0.1), Driven)


def test_a_start_beside_a_wall_whose_cells_the_body_touches_is_left():
    cells = room()
    answer = planned(cells, (1.0, 0.28, 0.0), (4.0, 2.0))  # 2 cm into the cells of the wall
    assert isinstance(answer, Driven)


def test_a_start_in_an_obstacle_is_refused():
    cells = room()
    cells[30:50, 10:40] = 100
    assert isinstance(planned(cells, (1.2, 2.0, 0.0), (4.0, 2.0)), StartOccupied)


def test_a_goal_heading_into_the_wall_is_refused():
    assert isinstance(planned(room(), (1.2, 2.0, 0.0), (5.4, 2.0), 0.0), GoalOccupied)
    assert isinstance(planned(room(), (1.2, 2.0, 0.0), (5.4, 2.0), math.pi), Driven)


def test_a_goal_outside_the_map_is_told():
    assert isinstance(planned(room(), (1.2, 2.0, 0.0), (7.0, 2.0)), OutsideMap)


def test_outlines_are_obstacles():
    wall = np.array([(3.0, 0.0, 3.0, 4.0)])
    assert isinstance(planned(room(), (1.2, 2.0, 0.0), (4.8, 2.0), segments=wall), NoPath)


def test_unknown_cells_are_obstacles_if_asked():
    cells = room()
    cells[:, 50:70] = -1
    assert isinstance(planned(cells, (1.2, 2.0, 0.0), (4.8, 2.0)), Driven)
    assert isinstance(planned(cells, (1.2, 2.0, 0.0), (4.8, 2.0), unknown="blocked"), NoPath)


def test_two_calls_give_the_same_path():
    one, two = (planned(divided(), (1.2, 1.0, 0.4), (4.8, 1.0), 2.0) for _ in range(2))
    assert (one.points == two.points).all()
    assert (one.headings == two.headings).all()


@pytest.mark.parametrize("heading", [0.4, 2.0, -1.0])
def test_a_mirrored_scene_has_a_path_of_the_same_length(heading):
    cells = divided()
    here = planned(cells, (1.2, 1.0, 0.3), (4.8, 1.0), heading)
    there = planned(np.ascontiguousarray(cells[::-1]), (1.2, 3.0, -0.3), (4.8, 3.0), -heading)
    assert there.length == pytest.approx(here.length, rel=0.01)


def test_a_turned_map_turns_the_path():
    here = planned(divided(), (1.2, 1.0, 0.3), (4.8, 1.0), 0.4)
    c, s = math.cos(0.7), math.sin(0.7)
    turned = lambda x, y: (c * x - s * y, s * x + c * y)  # noqa: E731
    there = planned(divided(), (*turned(1.2, 1.0), 1.0), turned(4.8, 1.0), 1.1, origin=(0.0, 0.0, 0.7))
    assert there.length == pytest.approx(here.length, rel=1e-3)


def test_smoothing_shortens_and_never_costs_more():
    lengths = [planned(divided(), (1.2, 1.0, 0.0), (4.8, 1.0), rounds=rounds).length for rounds in (0, 1, 6)]
    assert lengths[0] >= lengths[1] >= lengths[2]
    assert lengths[2] < 0.97 * lengths[0]


def test_a_flood_counts_straight_and_diagonal_steps():
    ahead = distances_to(np.ones((30, 30), dtype=np.bool_), (5, 5), (5, 25), 100.0)
    assert ahead[5, 25] == pytest.approx(20.0 / 1.0275, rel=1e-5)
    assert ahead[25, 25] == pytest.approx(20.0 * math.sqrt(2.0) / 1.0275, rel=1e-3)
    assert ahead[15, 25] == pytest.approx(10.0 * math.sqrt(5.0) / 1.0275, rel=1e-3)


def test_a_flood_is_infinite_behind_a_wall():
    passable = np.ones((10, 10), dtype=np.bool_)
    passable[:, 5] = False
    assert np.isinf(distances_to(passable, (5, 2), (5, 8), 100.0)[5, 8])


def test_split_moves_lead_to_the_same_place_and_merge_again():
    moves = np.array([(0.5, 3.0, 0.0), (0.0, 0.0, 0.4), (0.0, -2.0, 0.0)])
    parts = split(moves, 0.4)
    assert np.abs(parts[:, 1]).max() <= 0.4
    assert poses_after(np.zeros(3), parts)[-1] == pytest.approx(poses_after(np.zeros(3), moves)[-1])
    assert merged(parts) == pytest.approx(moves)


def test_a_move_that_is_only_rounding_gives_no_point():
    moves = np.array([(0.0, 1.0, 0.0), (0.5, -1e-7, 0.0), (0.0, 1.0, 0.0)])
    assert sampled(np.zeros(3), moves) == pytest.approx(np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0)]), abs=1e-6)


def test_costs_are_those_of_the_moves():
    # 3 forwards, 2 backwards at 1.5 each, one switch of 0.3, 0.4 rad at 2.
    moves = np.array([(0.5, 3.0, 0.0), (0.0, 0.0, 0.4), (0.0, -2.0, 0.0)])
    assert cost_of(moves, 0.5, 0.3, 2.0) == pytest.approx(3.0 + 3.0 + 0.3 + 0.8)
