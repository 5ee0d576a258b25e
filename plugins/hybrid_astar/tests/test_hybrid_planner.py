"""The planner as a plugin: headings in the path, what follows from the robot, and navloom check."""

import math
from dataclasses import replace

import numpy as np
import pytest
from navloom import Path, PlanFailure
from navloom.testing import closed, make, open_floor, planner_input, robot
from navloom_hybrid_astar.adapter import HybridAstar
from navloom_hybrid_astar.params import HybridAstarParams

STEERED = {"drive": "ackermann", "wheelbase": 0.5, "max_steering": math.atan(0.5)}
"""A radius of 1 m."""


@pytest.mark.navloom_plugin("planner.hybrid_astar")
@pytest.mark.slow
def test_it_passes(plugin_check):
    plugin_check()


def test_an_ackermann_robot_plans_with_a_tenth_more_than_its_radius_and_never_in_place():
    settings = HybridAstarParams().settings(replace(robot(), **STEERED))
    assert settings.radius == pytest.approx(1.1)
    assert math.isinf(settings.turn)


def test_a_differential_robot_takes_the_radius_at_full_speed_and_turn_rate():
    settings = HybridAstarParams().settings(replace(robot(), max_linear=1.5, max_angular=0.5))
    assert settings.radius == pytest.approx(3.0)
    assert settings.turn == pytest.approx(3.0)


def test_a_body_that_turns_fast_takes_at_least_half_its_circumscribed_radius():
    bar = np.array([(0.6, -0.2), (0.6, 0.2), (-0.6, 0.2), (-0.6, -0.2)])
    settings = HybridAstarParams().settings(replace(robot(), footprint=bar, max_linear=0.1, max_angular=2.0))
    assert settings.radius == pytest.approx(0.5 * math.hypot(0.6, 0.2))


def test_a_path_has_a_heading_at_each_point_and_ends_in_the_goal_s():
    given = planner_input(open_floor(), (0.0, 0.0), (2.0, 1.0))
    request = replace(given.request, any_heading=False, goal=replace(given.request.goal, heading=1.5))
    answer = make(HybridAstar).plan(replace(given, request=request))
    assert isinstance(answer, Path)
    assert len(answer.headings) == len(answer.points)
    assert answer.headings[-1] == pytest.approx(1.5)


def test_without_a_heading_asked_for_a_straight_way_stays_straight():
    given = planner_input(open_floor(), (0.0, 0.0), (2.0, 1.0))
    request = replace(given.request, any_heading=True, start=replace(given.request.start, heading=math.atan2(1.0, 2.0)))
    answer = make(HybridAstar).plan(replace(given, request=request))
    assert answer.length == pytest.approx(math.sqrt(5.0))


def test_a_failure_names_place_and_kind():
    answer = make(HybridAstar).plan(planner_input(closed(1.0), (0.0, 0.0), (2.0, 0.0)))
    assert isinstance(answer, PlanFailure)
    assert answer.kind in {"no_path", "outside_map"}
