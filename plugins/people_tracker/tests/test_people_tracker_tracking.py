"""People in made scenes: what a track says of them, what hides them, and that nothing that stands gets a velocity."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from navloom.runs.ospa import ospa
from navloom_people_tracker.bodies import bodies_in
from navloom_people_tracker.params import PeopleTrackerParams
from navloom_people_tracker.tracking import Tracker
from numpy.typing import NDArray
from tracker_scenes import Floats, Scene, room, tracked, walker, wanderer

FREE = lambda points: np.zeros(len(points), np.int64)  # noqa: E731  # a map without walls


@pytest.mark.parametrize("legs", [True, False])
@pytest.mark.parametrize(
    ("place", "velocity"),
    [((1.5, 0.3), (0.8, 0.0)), ((5.0, 0.3), (-0.8, 0.0)), ((3.0, -3.0), (0.0, 1.2)), ((-4.0, 2.0), (0.5, -0.5))],
)
def test_one_person_is_one_track_with_its_place_and_velocity(
    place: tuple[float, float], velocity: tuple[float, float], legs: bool
) -> None:
    scene = Scene(walls=room(6.0), people=[walker(*place, *velocity)], legs=legs)
    for time, tracks in tracked(scene, 3.5):
        if time >= 2.0:
            assert tracks.ids.tolist() == [1]
            true = (place[0] + velocity[0] * time, place[1] + velocity[1] * time, *velocity)
            assert (
                np.abs(tracks.means[0, :2] - true[:2]).max() < 0.2
                and np.abs(tracks.means[0, 2:] - true[2:]).max() < 0.35
            )


def test_the_error_of_a_track_is_within_what_its_covariance_says() -> None:
    inside = []
    for time, tracks in tracked(Scene(walls=room(6.0), people=[walker(3.0, -3.0, 0.0, 1.0)]), 5.0):
        if time >= 2.0:
            error = tracks.means[0] - (3.0, -3.0 + time, 0.0, 1.0)
            inside.append(error @ np.linalg.inv(tracks.covariances[0]) @ error < 13.3)  # 99 % of chi², 4
    assert np.mean(inside) > 0.9


def test_a_person_keeps_its_number_behind_a_pillar_and_is_unsure_there() -> None:
    pillar = np.array([(2.0, 0.0, 0.35)])
    scene = Scene(walls=room(6.0), discs=pillar, people=[walker(4.0, -3.0, 0.0, 1.0)])
    unseen, sigma = 0.0, []
    for time, tracks in tracked(scene, 5.5):
        if time >= 1.5:
            assert tracks.ids.tolist() == [1], time
            unseen = max(unseen, time - tracks.seen[0])
            sigma.append(math.sqrt(tracks.covariances[0, 1, 1]))
    assert unseen > 0.5 and max(sigma) > 3.0 * min(sigma)


def test_a_person_who_is_gone_has_no_track_half_a_second_later() -> None:
    scene = Scene(walls=room(6.0), people=[lambda time: (3.0, -3.0 + time) if time < 3.0 else (100.0, 0.0)])
    counts = {round(time, 1): len(tracks.ids) for time, tracks in tracked(scene, 4.0)}
    assert counts[2.9] == 1 and counts[3.6] == 0


def test_a_person_who_stops_stands_and_one_who_goes_on_has_a_velocity_again() -> None:
    def person(time: float) -> tuple[float, float]:
        return (3.0, -2.0 + min(time, 3.0) + max(0.0, time - 6.0))

    scene = Scene(walls=room(6.0), people=[person], legs=False)
    speeds = {round(time, 1): np.hypot(*tracks.means[:, 2:].T).tolist() for time, tracks in tracked(scene, 9.0)}
    assert speeds[2.9][0] == pytest.approx(1.0, abs=0.2)
    assert speeds[5.5][0] < 0.1 and speeds[8.0][0] == pytest.approx(1.0, abs=0.2)


def test_the_velocity_of_a_cylinder_that_turns_back_is_known_three_scans_later() -> None:
    def cylinder(time: float) -> tuple[float, float]:
        return 4.0, 1.75 * (2.0 - abs(time - 3.0))

    scene = Scene(walls=room(7.0), people=[cylinder], legs=False, radius=0.5)
    ids, velocities = set(), {}
    for time, tracks in tracked(scene, 4.0):
        ids.update(tracks.ids.tolist())
        velocities[round(time, 1)] = tracks.means[0, 2:] if len(tracks.ids) else np.full(2, np.nan)
    assert velocities[2.9] == pytest.approx([0.0, 1.75], abs=0.2)
    assert velocities[3.4] == pytest.approx([0.0, -1.75], abs=0.3) and ids == {1}


@pytest.mark.parametrize("speed", [0.8, 1.4, 2.0])
def test_a_cylinder_from_behind_a_wall_has_its_velocity_half_a_second_after_it_is_whole(speed: float) -> None:
    """Its outline leaves the shadow of the wall at y = -1: whole at 2 s, and its first echoes 1 m earlier."""
    wall = np.array([(2.0, -6.0, 2.0, -0.5)])
    scene = Scene(walls=np.vstack([room(7.0), wall]), people=[walker(4.0, -0.5 - 2.0 * speed, 0.0, speed)], legs=False,
                  radius=0.5)  # fmt: skip
    *_, (_, tracks) = tracked(scene, 2.6)
    assert tracks.means[:, 2:] == pytest.approx(np.array([(0.0, speed)]), abs=0.25)


def test_a_cylinder_that_comes_into_reach_is_seen_to_move_in_time() -> None:
    """It comes at 0.7 m/s towards a robot at 2 m/s, whose laser has no echo beyond 10 m.

    Its front is within reach after 1.7 s, at a distance of 10 m. 1.5 s later, when it is 6 m away, it is known.
    """
    scene = Scene(
        people=[walker(15.2, 0.2, -0.7, 0.0)], legs=False, radius=0.5, robot=lambda time: (2.0 * time, 0.0, 0.0),
        reach=10.0, sigma=0.03,
    )  # fmt: skip
    known = [time for time, tracks in tracked(scene, 3.3) if len(tracks.ids)]
    assert known and known[0] < 3.2


def test_who_follows_others_is_seen_to_move() -> None:
    """Three run at 2 m/s, 3 m apart: where one is, another was 1.5 s before. The last is within reach at 2.6 s."""
    people = [walker(x, 1.2, -2.0, 0.0) for x in (9.0, 12.0, 15.0)]
    *_, (_, tracks) = tracked(Scene(people=people, beams=480, reach=10.0, sigma=0.03), 4.3)
    last = tracks.means[tracks.means[:, 0].argmax()]
    assert last == pytest.approx(np.array([6.6, 1.2, -2.0, 0.0]), abs=0.3)


def test_a_disc_that_was_taken_to_rest_moves_again_by_its_places() -> None:
    """Its speed is held at 0 while nothing tells that it moves, so that it tells nothing either."""
    tracker = Tracker(PeopleTrackerParams())
    scene = Scene(people=[walker(4.0, -1.0, 0.0, 0.6)], legs=False, radius=0.5)
    for time, beams in scene.scans(2.2):
        tracker.see(time, "laser", np.zeros(3), beams, math.radians(1.0), np.full(len(beams), -1))
        tracker.tracks.evidence[:] = 0.0
        if time < 1.5:
            tracker.tracks.is_moving[:] = False
            tracker.tracks.modes[:, :, 2:] = 0.0
            tracker.tracks.means[:, 2:] = 0.0
    assert tracker.tracks.means[0, 2:] == pytest.approx([0.0, 0.6], abs=0.15)


def test_wheels_that_slip_do_not_change_the_velocities_of_what_moves() -> None:
    """Six cylinders, and a robot at 1.5 m/s that misses 1.5° in 0.1 s, which at 4 m is a speed of 1 m/s."""
    ways = [(5.0, -3.0, 0.0, 1.0), (6.0, 3.0, 0.0, -1.0), (8.0, 0.5, -0.8, 0.0), (4.0, 4.0, 0.6, -0.6),
            (2.0, -4.0, 0.7, 0.7), (9.0, -2.0, -0.5, 0.5)]  # fmt: skip
    scene = Scene(people=[walker(*way) for way in ways], legs=False, radius=0.5, slip=0.07, sigma=0.02,
                  robot=lambda time: (1.5 * time, 0.0, 0.0))  # fmt: skip
    errors = []
    for time, tracks in tracked(scene, 3.0):
        if time < 1.5:
            continue
        speeds = np.hypot(tracks.means[:, 2], tracks.means[:, 3])  # the same in all frames
        errors += np.abs(speeds[:, None] - np.array([np.hypot(*way[2:]) for way in ways])).min(axis=1).tolist()
    assert len(errors) > 60 and np.percentile(errors, 90) < 0.4


def test_known_discs_that_touch_in_the_view_are_two_bodies() -> None:
    """Together, their echoes are wider than any body; nothing tells that they move."""
    discs = np.array([(4.0, -0.55, 0.5), (4.0, 0.55, 0.5)])
    *_, (_, beams) = Scene(discs=discs, sigma=0.0).scans(0.1)
    points = beams[beams[:, 4] > 0.0, 2:4]
    marks = np.zeros((len(points), 2), np.bool_)
    for expected, found in ((discs, 2), (discs[:, :2] * (1.0, 20.0), 0)):
        given = np.column_stack([expected[:, :2], discs[:, 2]])
        bodies, _, _ = bodies_in(points, marks, (0.0, 0.0), math.radians(1.0), given, PeopleTrackerParams())
        assert len(bodies.places) == found
        assert bodies.places == pytest.approx(discs[:found, :2], abs=0.03)


def test_a_cylinder_that_is_hidden_in_part_keeps_its_centre() -> None:
    """A pillar hides a side of it for a second: what is seen of it is up to 0.4 m off its centre."""
    scene = Scene(walls=room(7.0), discs=np.array([(2.0, 0.5, 0.1)]), people=[walker(4.0, -2.0, 0.0, 1.0)], legs=False,
                  radius=0.5)  # fmt: skip
    for time, tracks in tracked(scene, 4.5):
        if time >= 2.0:
            assert tracks.means[:, :2] == pytest.approx(np.array([(4.0, time - 2.0)]), abs=0.12), time


def test_who_stands_is_tracked_where_a_map_is_free_and_not_without_a_map() -> None:
    scene = Scene(discs=np.array([(2.0, 0.0, 0.25), (-2.0, 1.0, 0.8)]))  # the second one is too wide for a person
    *_, (_, with_map) = tracked(scene, 2.0, FREE)
    *_, (_, without) = tracked(scene, 2.0)
    assert with_map.means[:, :2].round(1).tolist() == [[2.0, 0.0]] and np.abs(with_map.means[:, 2:]).max() < 0.05
    assert not len(without.ids)


@pytest.mark.parametrize(
    ("legs", "count", "most"), [(True, 1, 0.1), (True, 5, 0.15), (True, 20, 0.2), (False, 1, 0.1), (False, 20, 0.4)]
)
def test_the_tracks_of_a_crowd_are_near_it(legs: bool, count: int, most: float) -> None:
    rng = np.random.default_rng(count)
    scene = Scene(walls=room(6.5), people=[wanderer(rng, 5.5) for _ in range(count)], legs=legs, seed=count)
    found = []
    for time, tracks in tracked(scene, 10.0):
        truth = np.array([person(time) for person in scene.people])
        if time > 2.0:
            found.append(ospa(truth[np.hypot(*truth.T) < 8.0], tracks.means[:, :2], 1.0).total)
    assert np.mean(found) < most


def clutter(seed: int) -> Floats:
    """(n, 3) discs from poles to pillars around the origin, m."""
    rng = np.random.default_rng(seed)
    discs = np.column_stack([rng.uniform(-5.5, 5.5, (25, 2)), rng.choice([0.02, 0.04, 0.06, 0.1, 0.2, 0.4], 25)])
    kept: NDArray[np.bool_] = np.hypot(discs[:, 0], discs[:, 1]) > 1.5 + discs[:, 2]
    return np.asarray(discs[kept])


ROBOTS: dict[str, Callable[[float], tuple[float, float, float]]] = {
    "turns": lambda time: (0.0, 0.0, time),
    "circles": lambda time: (0.8 * math.sin(time / 2), 0.8 * math.cos(time / 2) - 0.8, -time / 2),
    "goes to and fro": lambda time: (0.9 * math.sin(0.8 * time), 0.0, 0.3 * math.sin(time)),
}


@pytest.mark.parametrize("beams", [180, 360, 720])
@pytest.mark.parametrize("drift", [0.0, 0.03])
@pytest.mark.parametrize("robot", ROBOTS)
def test_no_wall_or_pole_moves_when_the_robot_does(robot: str, drift: float, beams: int) -> None:
    scene = Scene(walls=room(6.0), discs=clutter(beams), robot=ROBOTS[robot], beams=beams, sigma=0.02, drift=drift)
    speeds = [np.hypot(*tracks.means[:, 2:].T).max(initial=0.0) for _, tracks in tracked(scene, 8.0)]
    assert max(speeds) <= 0.3


def test_the_beams_of_a_slow_scanner_are_placed_by_their_own_times() -> None:
    scene = Scene(walls=room(5.0), discs=clutter(3), robot=ROBOTS["turns"], scan_time=0.08, beams=180)
    assert not any(len(tracks.ids) for _, tracks in tracked(scene, 4.0))


def test_a_turning_robot_still_sees_who_walks() -> None:
    scene = Scene(
        walls=room(6.0), discs=clutter(5), people=[walker(2.0, -2.0, 0.0, 1.0)], robot=ROBOTS["turns"], drift=0.02
    )
    *_, (time, tracks) = tracked(scene, 3.0)
    assert len(tracks.ids) == 1 and tracks.means[0, 3] == pytest.approx(1.0, abs=0.3), time


def test_two_runs_give_the_same_bits() -> None:
    def last() -> bytes:
        *_, (_, tracks) = tracked(Scene(walls=room(6.0), people=[walker(3.0, -2.0, 0.0, 1.0)]), 2.0)
        return tracks.means.tobytes() + tracks.covariances.tobytes()

    assert last() == last()
