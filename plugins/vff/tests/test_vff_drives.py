"""Closed loop in lockstep on the simulated robot: clutter, doors and dead ends, without a map. No contact."""

from __future__ import annotations

from functools import partial

import avoider_drives
import numpy as np
import pytest
from avoider_drives import BOTH_KINDS, BOUNDS, CROSSTALK, MIRRORS, PAIRS, UP, all_of, told, way_past
from navloom import Box, Place, World
from navloom.config import load_config
from navloom.runs.episode import run_episode

drive, field = partial(avoider_drives.drive, avoider="vff"), partial(avoider_drives.field, avoider="vff")
door, dead_end = partial(avoider_drives.door, avoider="vff"), partial(avoider_drives.dead_end, avoider="vff")
sudden = partial(avoider_drives.sudden, avoider="vff")


@pytest.mark.slow
@BOTH_KINDS
def test_a_few_fields_are_crossed(sensors: str) -> None:
    assert [field(seed, sensors=sensors).word for seed in (1, 2)] == ["reached"] * 2


def test_a_dead_end_is_left_by_following_its_wall() -> None:
    ending = dead_end(3.0, 3.0, 0)
    assert ending.word == "reached"
    assert np.abs(ending.track[:, 0]).max() > 1.7  # it went outside


def test_a_door_twice_as_wide_as_the_robot_is_not_entered_but_one_three_times_as_wide_is() -> None:
    """A known fault of potential fields: both posts push the robot out of a door that it fits through."""
    assert way_past(door(1.6, 0)) == "around"
    assert way_past(door(2.4, 0)) == "through"


def test_a_goal_in_front_of_a_wall_is_reached_unless_the_wall_pushes_from_behind_the_goal() -> None:
    world = World("wall", (Box("wall", (-6.0, 6.0), (6.0, 6.2)),), bounds=BOUNDS)
    start, goal = Place(0.0, 0.0, UP), Place(0.0, 5.2)
    assert drive(world, start, goal, 1).word == "reached"
    assert drive(world, start, goal, 1, params=["stops_at_target=false"]).word == "trapped"


def test_a_target_behind_is_turned_to_although_a_wall_pushes() -> None:
    """6 m less 0.3 m of tolerance: no way along the wall."""
    world = World("wall", (Box("wall", (-6.0, 6.0), (1.2, 1.4)),), bounds=BOUNDS)
    ending = drive(world, Place(0.0, 0.0, 1.0), Place(0.0, -6.0), 1)
    assert ending.word == "reached"
    assert np.hypot(*np.diff(ending.track, axis=0).T).sum() < 6.5


def test_a_room_without_a_way_out_is_reported_as_a_trap() -> None:
    walls = (
        Box("left", (-2.2, -2.0), (-2.2, 2.2)),
        Box("right", (2.0, 2.2), (-2.2, 2.2)),
        Box("rear", (-2.2, 2.2), (-2.2, -2.0)),
        Box("front", (-2.2, 2.2), (2.0, 2.2)),
    )
    ending = drive(World("room", walls, bounds=BOUNDS), Place(0.0, 0.0, UP), Place(0.0, 6.0), 1)
    assert ending.word == "trapped"
    assert 60.0 < ending.seconds < 180.0


def test_the_same_seed_gives_the_same_drive() -> None:
    np.testing.assert_array_equal(field(8).track, field(8).track)


@pytest.mark.slow
def test_as_printed_fields_are_crossed() -> None:
    printed = [avoider_drives.field(seed, avoider="vff@printed").word for seed in (0, 3)]
    assert printed == ["reached"] * 2


def test_swapped_in_while_the_other_avoider_drives_it_ends_the_papers_experiment() -> None:
    """Obstacle O is passed from 4.4 s to about 17 s."""
    episode = run_episode(
        load_config(
            "paper",
            [
                'alternative=[{role="avoider",plugin="vff",shadow=true}]',
                'event=[{at=7.0,do="swap",role="avoider",name="vff"}]',
            ],
        )
    )
    found = episode.summary()
    assert (found["truly_reached"], found["swaps"], found["collisions"]) == (True, 1, 0)
    assert any(not engaged and time > 7.0 for time, engaged in episode.recorder.engaged)


def test_driving_from_the_start_it_passes_obstacle_o() -> None:
    found = run_episode(load_config("paper", ['avoider={plugin="vff"}'])).summary()
    assert (found["truly_reached"], found["collisions"], found["recoveries"]) == (True, 0, 0)


@pytest.mark.slow
@BOTH_KINDS
def test_at_least_45_of_50_fields_are_crossed_and_none_with_contact(sensors: str) -> None:
    words = told(f"fields, {sensors}", all_of(field, [(seed,) for seed in range(50)], sensors=sensors))
    assert set(words) <= {"reached", "trapped"}
    assert words["reached"] >= 45


@pytest.mark.slow
def test_fields_with_crosstalk_are_crossed_or_reported_as_trapped() -> None:
    """In each tick, each pair of neighbouring sonars has crosstalk with a probability of 5 %; sigma 3 cm."""
    words = told("fields, crosstalk", all_of(field, [(seed,) for seed in range(50)], sensors=CROSSTALK))
    assert set(words) <= {"reached", "trapped"}
    assert words["reached"] >= 40


@pytest.mark.slow
@BOTH_KINDS
def test_doors(sensors: str) -> None:
    """The curve of the README. Doors that are not passed are left round the end of the wall; nothing is touched."""
    widths = [round(1.0 + 0.2 * k, 1) for k in range(10)]
    endings = all_of(door, [(width, approach) for width in widths for approach in range(20)], sensors=sensors)
    for k, width in enumerate(widths):
        words = told(f"door {width} m", endings[20 * k : 20 * k + 20], way_past)
        assert set(words) <= {"through", "around", "trapped"}
        if width <= 1.6:
            assert words["through"] == 0
        if width >= 2.6:
            assert words["through"] == 20


@pytest.mark.slow
@BOTH_KINDS
def test_dead_ends_are_left_or_reported_as_trapped_and_never_touched(sensors: str) -> None:
    for width, depth in [(1.6, 2.0), (2.0, 1.5), (2.4, 2.0), (3.0, 3.0), (4.0, 3.0), (5.0, 4.0)]:
        endings = all_of(dead_end, [(width, depth, approach) for approach in range(20)], sensors=sensors)
        words = told(f"dead end {width} x {depth} m", endings)
        assert set(words) <= {"reached", "trapped"}
        assert words["reached"] >= 15


@pytest.mark.slow
@BOTH_KINDS
def test_an_obstacle_that_appears_close_ahead_is_not_touched(sensors: str) -> None:
    words = told(f"sudden, {sensors}", all_of(sudden, [(seed,) for seed in range(30)], sensors=sensors))
    assert set(words) <= {"reached", "trapped"}
    assert words["reached"] >= 15
    free = all_of(sudden, [(seed,) for seed in range(30)], sensors=sensors, params=["arc_check=false"])
    assert set(told("the same without arc check", free)) == {"reached"}  # it is the check that traps the robot


@pytest.mark.slow
def test_fewer_fields_are_crossed_without_the_departures_from_the_text() -> None:
    rows = [(seed,) for seed in range(24)]
    default = told("24 fields", all_of(field, rows))["reached"]
    costly = ('disc="inscribed"', "hesitation=3600.0", 'leave_rule="heading"', "slows_for_turns=false")
    for change in costly:
        assert told(f"24 fields, {change}", all_of(field, rows, params=[change]))["reached"] <= default - 5
    for change in ("slow_force=0.0", "slows_leaving=true", "may_pull=true", "arc_check=false"):
        assert told(f"24 fields, {change}", all_of(field, rows, params=[change]))["reached"] >= default - 3


@pytest.mark.slow
def test_a_weaker_push_opens_doors_and_leaves_less_room() -> None:
    weak = {"params": ["balance=0.15"]}
    words = told("door 1.8 m, balance 0.15", all_of(door, [(1.8, k) for k in range(20)], **weak), way_past)
    assert words["through"] >= 15
    endings = all_of(field, [(seed,) for seed in range(24)], **weak)
    assert 10 <= told("24 fields, balance 0.15", endings)["reached"] < 24
    assert min(ending.gap for ending in endings) < 0.25


@pytest.mark.slow
def test_with_poor_sensors_it_is_no_worse_than_the_readme_states() -> None:
    """The limits in the README: the figures are no worse than stated there."""
    pairs = told("fields, pairs", all_of(field, [(seed,) for seed in range(50)], sensors=PAIRS))
    assert pairs["contact"] <= 8
    mirrors = told("fields, mirrors", all_of(field, [(seed,) for seed in range(50)], sensors=MIRRORS))
    assert mirrors["contact"] == 0 and mirrors["reached"] >= 45
    for width, stated in ((1.2, 8), (1.4, 16), (1.6, 4), (1.8, 0), (2.0, 0)):
        endings = all_of(door, [(width, k) for k in range(20)], sensors=MIRRORS)
        assert told(f"door {width} m, mirrors", endings, way_past)["contact"] <= stated


@pytest.mark.slow
def test_as_printed_thirty_fields() -> None:
    printed = partial(avoider_drives.field, avoider="vff@printed")
    assert told("fields, printed", all_of(printed, [(seed,) for seed in range(30)]))["reached"] >= 26
