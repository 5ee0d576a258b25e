"""The cost field, compared with numbers by hand and shortest paths of networkx."""

import math

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_dwa.field import (
    COSTLIEST,
    cell_cost,
    centre_field,
    field_value,
    fill_field,
    obstacle_distance,
    seed_field,
    spread,
)


def test_the_field_is_centred_on_the_robot_by_whole_cells():
    origin = np.zeros(2, np.int64)
    centre_field(origin, 1.26, -0.31, 0.1, 21)
    assert origin.tolist() == [12 - 10, -4 - 10]


def test_chamfer_distance_is_3_along_and_4_across():
    distance = np.zeros((7, 7), np.int32)
    origin = np.array([-3, -3])
    obstacle_distance(np.array([[0.05, 0.05, 0.0]]), (0.0, 0.0, 0.0), origin, 0.1, distance)
    assert distance[3, 3] == 0
    assert distance[3, 0] == 9
    assert distance[0, 0] == 12
    assert distance[1, 2] == 4 + 3


def test_obstacles_are_placed_by_the_pose():
    """At (1, 2) m and looking along y, what is 0.35 m ahead is at (1, 2.35)."""
    distance = np.zeros((11, 11), np.int32)
    origin = np.zeros(2, np.int64)
    pose = (1.01, 2.01, 0.5 * math.pi)
    centre_field(origin, pose[0], pose[1], 0.1, 11)
    obstacle_distance(np.array([[0.35, 0.0, 0.0]]), pose, origin, 0.1, distance)
    assert np.argwhere(distance == 0).tolist() == [[5 + 3, 5]]


def test_a_metre_costs_1_far_off_and_most_where_the_robot_would_touch():
    assert cell_cost(0.39, 0.4, 0.3, 3.0) == COSTLIEST
    assert cell_cost(0.4, 0.4, 0.3, 3.0) == pytest.approx(4.0)
    assert cell_cost(0.55, 0.4, 0.3, 3.0) == pytest.approx(2.5)
    assert cell_cost(0.7, 0.4, 0.3, 3.0) == pytest.approx(1.0)


def test_without_obstacles_the_wave_is_10_along_and_14_across():
    costs, seeds, found = np.full((9, 9), 10, np.uint8), np.full((9, 9), -1, np.int32), np.zeros((9, 9), np.int32)
    seeds[4, 4] = 0
    spread(costs, seeds, found)
    assert found[4, 8] == 40
    assert found[0, 0] == 56
    assert found[2, 5] == 14 + 10


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_the_wave_is_the_shortest_path_of_networkx(seed):
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(3, 10)), int(rng.integers(3, 10)))
    costs = rng.integers(10, 256, shape).astype(np.uint8)
    seeds = np.where(rng.random(shape) < 0.1, rng.integers(0, 3000, shape), -1).astype(np.int32)
    seeds[0, 0] = 5
    found = np.zeros(shape, np.int32)
    spread(costs, seeds, found)
    graph = nx.DiGraph()
    for r, k in np.ndindex(shape):
        if seeds[r, k] >= 0:
            graph.add_edge("start", (r, k), weight=int(seeds[r, k]))
        for dr, dk in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            if 0 <= r + dr < shape[0] and 0 <= k + dk < shape[1]:
                step = 14 if dr and dk else 10
                graph.add_edge((r, k), (r + dr, k + dk), weight=step * int(costs[r + dr, k + dk]) // 10)
    wanted = nx.single_source_dijkstra_path_length(graph, "start")
    assert {place: int(found[place]) for place in np.ndindex(shape)} == {
        place: cost for place, cost in wanted.items() if place != "start"
    }


def test_a_target_outside_seeds_the_border_at_its_distance():
    seeds = np.zeros((5, 5), np.int32)
    seed_field(seeds, np.array([0, 0]), 0.1, 1.25, 0.25)
    assert seeds[2, 2] == -1
    assert seeds[2, 4] == pytest.approx(80, abs=1)  # 0.45 to 1.25 m
    assert seeds[2, 0] == pytest.approx(120, abs=1)


def test_a_target_inside_seeds_the_cells_about_it_at_their_distances():
    """0.02 m right of a cell's centre: 2 of 10 units a cell; 8 to the next on the right, 12 to that on the left."""
    seeds = np.zeros((5, 5), np.int32)
    seed_field(seeds, np.array([0, 0]), 0.1, 0.27, 0.25)
    assert seeds[2].tolist() == [-1, 12, 2, 8, -1]
    assert (seeds >= 0).sum() == 9


def test_the_way_leads_round_a_wall_and_not_through_it():
    """A wall 2 m long 1 m ahead of the robot, target behind it: straight 2 m; round its end about 2.8 m and more."""
    wall = np.array([[1.0, y, 0.0] for y in np.arange(-1.0, 1.01, 0.05)])
    origin, distance, to_go = np.zeros(2, np.int64), np.zeros((81, 81), np.int32), np.zeros((81, 81), np.int32)
    pose = (0.05, 0.05, 0.0)
    fill_field(wall, pose, (2.05, 0.05), origin, 0.1, 0.2, 0.1, 0.0, distance, to_go)
    found = field_value(to_go, origin, 0.1, 0.05, 0.05) * 0.1 / 10
    assert 2.0 * math.hypot(1.0, 1.2) - 0.1 < found < 4.0
    assert field_value(distance, origin, 0.1, 0.55, 0.05) * 0.1 / 3 == pytest.approx(0.5, abs=0.08)


def test_values_between_cells_are_bilinear_and_beyond_the_border_its_own():
    field = np.array([[0, 10, 20], [10, 20, 30], [20, 30, 40]], np.int32)
    origin = np.array([0, 0])
    assert field_value(field, origin, 1.0, 1.5, 1.5) == pytest.approx(20.0)
    assert field_value(field, origin, 1.0, 1.0, 1.75) == pytest.approx(17.5)
    assert field_value(field, origin, 1.0, -9.0, 0.5) == pytest.approx(0.0)
