"""Actors of world files: their courses by hand, and what a wrong table says."""

from __future__ import annotations

from pathlib import Path

import pytest
from navloom.geometry.actors import Body, Course, Walk
from navloom.worlds.tomlfile import toml_world
from navloom.worlds.world_errors import WorldError

PLACES = "[[actor]]\nway = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]]\n"


def actor(folder: Path, text: str):
    (folder / "w.toml").write_text(text, "utf-8")
    (found,) = toml_world("w.toml", folder).actors
    return found


def test_a_way_has_times_by_speed_and_waits(tmp_path: Path) -> None:
    """2 m at 1 m/s after 3 s of rest, 0.5 s of rest, 1 m at 2 m/s."""
    made = actor(tmp_path, PLACES + 'body = "legs"\nspeed = [1.0, 2.0]\nwaits = [3.0, 0.5, 0.0]')
    points = ((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (5.0, 2.0, 0.0), (5.5, 2.0, 0.0), (6.0, 2.0, 1.0))
    assert made.course == Course(points) and made.name == "actor 1"
    assert made.body == Body("legs", 0.44, 0.44, (0.0, 1.75))


def test_a_way_that_loops_goes_back_to_its_first_place(tmp_path: Path) -> None:
    made = actor(tmp_path, "[[actor]]\nway = [[0.0, 0.0], [2.0, 0.0]]\nspeed = 1.0\nloops = true")
    assert made.course == Course(((0.0, 0.0, 0.0), (2.0, 2.0, 0.0), (4.0, 0.0, 0.0)), loops=True)


def test_a_course_begins_when_its_actor_appears(tmp_path: Path) -> None:
    made = actor(tmp_path, "[[actor]]\nwaypoints = [[0, 1, 0], [2, 3, 0]]\nappears_at = 5.0\nphase = 0.5")
    assert made.appears_at == 5.0 and made.course.at(5.0).x == pytest.approx(1.5)


def test_one_place_is_an_actor_that_rests_there(tmp_path: Path) -> None:
    made = actor(tmp_path, '[[actor]]\nbody = "trolley"\nway = [[1.0, 2.0]]\nheading_deg = 90.0')
    assert made.course.at(7.0)[:2] == (1.0, 2.0) and made.course.at(7.0).heading == pytest.approx(1.5707963)


def test_goals_make_an_actor_that_gives_way(tmp_path: Path) -> None:
    made = actor(
        tmp_path, "[[actor]]\nstart = [0, 0]\ngoals = [[8, 0]]\nspeed = 1.0\nsees_robots = false\nflows = true"
    )
    assert made.course == Walk((0.0, 0.0), ((8.0, 0.0),), 1.0, 1.5, flows=True, sees_robots=False)


def test_one_of_a_flow_may_begin_again_elsewhere(tmp_path: Path) -> None:
    made = actor(tmp_path, "[[actor]]\nstart = [0, 0]\ngoals = [[8, 0]]\nflows = true\nentry = [-2, 1]")
    assert made.course.entry == (-2.0, 1.0) and (-2.0, 1.0) in made.places


def test_goals_may_loop(tmp_path: Path) -> None:
    assert actor(tmp_path, "[[actor]]\nstart = [0, 0]\ngoals = [[8, 0], [0, 0]]\nloops = true").course.loops


def test_the_bounds_hold_the_courses(tmp_path: Path) -> None:
    (tmp_path / "w.toml").write_text(PLACES, "utf-8")
    assert toml_world("w.toml", tmp_path).bounds == (-1.0, -1.0, 3.0, 2.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[actor]]", "no course, expected one of waypoints, way and goals"),
        (PLACES + "goals = [[1, 1]]", "way and goals, expected one of"),
        ("[[actor]]\nstart = [0, 0]\ngoals = [[1, 1]]\nentry = [1, 1]", "entry has no use without flows = true"),
        ("[[actor]]\nstart = [0, 0]\ngoals = [[1, 1]]\nflows = true\nloops = true", "flows and loops, expected one"),
        (PLACES + "sees_robots = false", "sees_robots has no use beside waypoints or way"),
        (PLACES + "speed = [1.0]", "speed: 1 of them, expected one speed for each piece of the way: 2"),
        (PLACES + "speed = 0.0", "speed = 0, expected a speed > 0"),
        (PLACES + "waits = [1.0, -1.0, 0.0]", "expected times >= 0"),
        (PLACES + 'body = "leg"', "expected one of disc, box, legs, trolley; did you mean 'legs'"),
        (PLACES + "size = [1.0, 2.0]", 'twice the diameter of the round body "disc"'),
        (PLACES + "keys = 'gazebo'", "expected one of linear, spline"),
        ("[[actor]]\nwaypoints = [[0, 0, 0]]\nspeed = 1.0", "speed has no use beside waypoints"),
        ("[[actor]]\nwaypoints = [[0, 0, 0]]\nloops = true", "expected a course that ends after 0 s"),
        ("[[actor]]\nwaypoints = [[1, 0, 0], [1, 2, 0]]", "waypoint 2 at 1 s, expected times from 0 that rise"),
        ("[[actor]]\ngoals = [[1, 1]]", "key 'start' is missing"),
        ("[[actor]]\nstart = [0, 0]\ngoals = [[1, 1]]\nmax_speed = 0.5", "max_speed = 0.5, expected at least speed"),
        (PLACES + "name = 'a'\n" + PLACES + "name = 'a'", "two obstacles are named 'a'"),
    ],
)
def test_a_wrong_table_is_explained(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(WorldError, match=r"w\.toml") as raised:
        actor(tmp_path, text)
    assert said in str(raised.value)
