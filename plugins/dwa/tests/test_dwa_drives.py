"""Closed loop in lockstep on the simulated robot: clutter, doors, dead ends and BARN worlds. No contact."""

from __future__ import annotations

from functools import partial

import avoider_drives
import numpy as np
import pytest
from avoider_drives import BARN, BOTH_KINDS, BOUNDS, CROSSTALK, LASER, UP, all_of, told, way_past
from navloom import Box, Place, World
from navloom.config import load_config
from navloom.runs.episode import run_episode

NEEDS_BARN = pytest.mark.skipif(not BARN.is_file(), reason="NAVLOOM_DATA names no folder with barn/barn_dev.npz")
drive, field = partial(avoider_drives.drive, avoider="dwa"), partial(avoider_drives.field, avoider="dwa")
door, dead_end = partial(avoider_drives.door, avoider="dwa"), partial(avoider_drives.dead_end, avoider="dwa")
sudden, barn = partial(avoider_drives.sudden, avoider="dwa"), partial(avoider_drives.barn, avoider="dwa")


@BOTH_KINDS
def test_a_field_is_crossed_without_a_stop(sensors: str) -> None:
    """15 m at 0.5 m/s are 30 s."""
    ending = field(1, sensors=sensors)
    assert ending.word == "reached"
    assert ending.seconds < 36.0
    assert ending.gap > 0.1


def test_a_door_of_twice_the_robot_is_passed() -> None:
    assert way_past(door(1.6, 0)) == "through"


def test_with_a_laser_a_door_with_10_cm_on_either_side_is_passed() -> None:
    ending = door(1.0, 0, sensors=LASER)
    assert way_past(ending) == "through"
    assert ending.gap > 0.03


def test_a_dead_end_is_driven_round() -> None:
    ending = dead_end(3.0, 3.0, 0, sensors=LASER)
    assert ending.word == "reached"
    assert np.abs(ending.track[:, 0]).max() > 1.7  # it went outside


def test_the_goal_is_driven_to_and_not_past() -> None:
    world = World("open", (), bounds=BOUNDS)
    ending = drive(world, Place(0.0, 0.0, UP), Place(0.0, 4.0), 1, settings=["navigation.goal_tolerance=0.1"])
    assert ending.word == "reached"
    assert ending.track[:, 1].max() < 4.05
    assert np.abs(ending.track[:, 0]).max() < 0.02


def test_a_target_behind_is_turned_to() -> None:
    """6 m less 0.3 m of tolerance."""
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
    room = World("room", walls, bounds=BOUNDS)
    settings = ["gate.monitor=false"]  # else it is trapped as soon as the gate does not let it back up
    options = {"sensors": LASER, "params": ["patience=10.0"], "settings": settings}
    ending = drive(room, Place(0.0, 0.0, UP), Place(0.0, 6.0), 1, **options)
    assert ending.word == "trapped"
    assert 10.0 < ending.seconds < 60.0


def test_the_same_seed_gives_the_same_drive() -> None:
    np.testing.assert_array_equal(door(1.6, 8).track, door(1.6, 8).track)


def test_driving_from_the_start_it_passes_obstacle_o() -> None:
    found = run_episode(load_config("paper", ['avoider={plugin="dwa"}'])).summary()
    assert (found["truly_reached"], found["collisions"], found["recoveries"]) == (True, 0, 0)


@NEEDS_BARN
@pytest.mark.parametrize("number", [7, 241])
def test_a_barn_world_is_crossed_without_a_map(number: int) -> None:
    assert barn(number).word == "reached"


@NEEDS_BARN
def test_a_barn_world_is_crossed_along_a_planned_path() -> None:
    """10 m at 2 m/s and 2 m/s^2 take 5.5 s."""
    ending = barn(121, knows_map=True)
    assert ending.word == "reached"
    assert ending.seconds < 8.0


@pytest.mark.slow
@BOTH_KINDS
def test_at_least_48_of_50_fields_are_crossed_and_none_with_contact(sensors: str) -> None:
    words = told(f"fields, {sensors}", all_of(field, [(seed,) for seed in range(50)], sensors=sensors))
    assert set(words) <= {"reached", "trapped"}
    assert words["reached"] >= 48


@pytest.mark.slow
def test_fields_with_crosstalk_are_crossed_or_reported_as_trapped() -> None:
    """In each tick, each pair of neighbouring sonars has crosstalk with a probability of 5 %; sigma 3 cm."""
    words = told("fields, crosstalk", all_of(field, [(seed,) for seed in range(50)], sensors=CROSSTALK))
    assert set(words) <= {"reached", "trapped"}


@pytest.mark.slow
@BOTH_KINDS
def test_doors(sensors: str) -> None:
    for width in (1.0, 1.1, 1.2, 1.3, 1.4, 1.6, 1.8, 2.0):
        words = told(f"door {width} m", all_of(door, [(width, k) for k in range(20)], sensors=sensors), way_past)
        assert set(words) <= {"through", "around", "trapped"}
        if width >= (1.0 if sensors == LASER else 1.6):
            assert words["through"] == 20


@pytest.mark.slow
@BOTH_KINDS
def test_dead_ends_are_left_or_reported_as_trapped_and_never_touched(sensors: str) -> None:
    for width, depth in [(1.6, 2.0), (2.0, 1.5), (2.4, 2.0), (3.0, 3.0), (4.0, 3.0), (5.0, 4.0)]:
        endings = all_of(dead_end, [(width, depth, approach) for approach in range(20)], sensors=sensors)
        words = told(f"dead end {width} x {depth} m, {sensors}", endings)
        assert set(words) <= {"reached", "trapped"}


@pytest.mark.slow
@BOTH_KINDS
def test_an_obstacle_that_appears_close_ahead_is_not_touched(sensors: str) -> None:
    words = told(f"sudden, {sensors}", all_of(sudden, [(seed,) for seed in range(30)], sensors=sensors))
    assert set(words) <= {"reached", "trapped"}
    assert words["reached"] >= 25


@pytest.mark.slow
@NEEDS_BARN
@pytest.mark.parametrize("knows_map", [False, True], ids=["no_map", "planned"])
def test_barn_worlds(knows_map: bool) -> None:
    endings = all_of(barn, [(number,) for number in range(1, 300, 6)], knows_map=knows_map)
    words = told("BARN", endings)
    print(f"mean time {np.mean([e.seconds for e in endings if e.word == 'reached']):.1f} s")
    assert words["contact"] <= 2
    assert words["reached"] >= 45


@pytest.mark.slow
@BOTH_KINDS
def test_the_objective_of_1997(sensors: str) -> None:
    """With the true footprint and the checks, and as in the paper."""
    rows = [(seed,) for seed in range(20)]
    words = told("1997, fields", all_of(field, rows, sensors=sensors, params=['objective="1997"']))
    assert set(words) <= {"reached", "trapped"}
    printed = [partial(avoider_drives.field, avoider="dwa@printed")]
    told("as printed, fields", all_of(printed[0], rows, sensors=sensors))
    told("1997, door 1.6 m", all_of(door, [(1.6, k) for k in range(10)], params=['objective="1997"']), way_past)
