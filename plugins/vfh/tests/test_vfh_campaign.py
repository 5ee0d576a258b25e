"""Closed loop in lockstep on the simulated robot: clutter, doors and dead ends, without a map. No contact."""

from __future__ import annotations

import numpy as np
import pytest
from avoider_drives import (
    BOTH_KINDS,
    BOUNDS,
    CROSSTALK,
    MIRRORS,
    PAIRS,
    UP,
    all_of,
    dead_end,
    door,
    drive,
    field,
    sudden,
    told,
    way_past,
)
from navloom import Box, Place, World
from navloom.config import load_config
from navloom.runs.episode import run_episode

NAMES = ("vfh", "vfh_plus", "vfh_star")
EACH = pytest.mark.parametrize("avoider", NAMES)
PRESET = pytest.mark.parametrize("preset", ["printed", "robust"])


@EACH
@PRESET
def test_a_field_is_crossed(avoider: str, preset: str) -> None:
    assert field(1, avoider=f"{avoider}@{preset}").word == "reached"


@EACH
@BOTH_KINDS
def test_a_door_twice_as_wide_as_the_robot_is_passed(avoider: str, sensors: str) -> None:
    """The VFF needs a door three times as wide."""
    assert way_past(door(1.6, 0, sensors=sensors, avoider=avoider)) == "through"


@EACH
def test_the_same_seed_gives_the_same_drive(avoider: str) -> None:
    np.testing.assert_array_equal(door(2.0, 1, avoider=avoider).track, door(2.0, 1, avoider=avoider).track)


def test_looking_one_step_ahead_drives_as_vfh_plus() -> None:
    star = door(1.6, 3, avoider="vfh_star", params=["look_ahead=1", "window=33"])
    np.testing.assert_array_equal(star.track, door(1.6, 3, avoider="vfh_plus").track)


@EACH
def test_a_room_without_a_way_out_is_reported_as_a_trap(avoider: str) -> None:
    walls = (
        Box("left", (-1.2, -1.0), (-1.2, 1.2)),
        Box("right", (1.0, 1.2), (-1.2, 1.2)),
        Box("rear", (-1.2, 1.2), (-1.2, -1.0)),
        Box("front", (-1.2, 1.2), (1.0, 1.2)),
    )
    ending = drive(World("room", walls, bounds=BOUNDS), Place(0.0, 0.0, UP), Place(0.0, 6.0), 1, avoider=avoider)
    assert ending.word == "trapped"


@EACH
def test_driving_from_the_start_it_passes_obstacle_o(avoider: str) -> None:
    found = run_episode(load_config("paper", [f'avoider={{plugin="{avoider}"}}'])).summary()
    assert (found["truly_reached"], found["collisions"], found["recoveries"]) == (True, 0, 0)


@pytest.mark.slow
@EACH
@BOTH_KINDS
def test_at_least_47_of_50_fields_are_crossed_and_none_with_contact(avoider: str, sensors: str) -> None:
    endings = all_of(field, [(seed,) for seed in range(50)], sensors=sensors, avoider=avoider)
    words = told(f"fields, {avoider}, {sensors}", endings)
    assert set(words) <= {"reached", "trapped"}
    assert words["reached"] >= 47


@pytest.mark.slow
@EACH
def test_fields_with_crosstalk_are_crossed_or_reported_as_trapped(avoider: str) -> None:
    """In each tick, each pair of neighbouring sonars has crosstalk with a probability of 5 %; sigma 3 cm."""
    endings = all_of(field, [(seed,) for seed in range(50)], sensors=CROSSTALK, avoider=avoider)
    words = told(f"fields, crosstalk, {avoider}", endings)
    assert set(words) <= {"reached", "trapped"}
    assert words["reached"] >= 35


@pytest.mark.slow
@EACH
@BOTH_KINDS
def test_doors(avoider: str, sensors: str) -> None:
    """The curve of the README: every door at least twice as wide as the robot is passed; nothing is touched."""
    widths = [1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0, 2.4]
    rows = [(width, approach) for width in widths for approach in range(20)]
    endings = all_of(door, rows, sensors=sensors, avoider=avoider)
    for k, width in enumerate(widths):
        words = told(f"door {width} m, {avoider}", endings[20 * k : 20 * k + 20], way_past)
        assert set(words) <= {"through", "around", "trapped"}
        if width >= 1.8:
            assert words["through"] == 20


@pytest.mark.slow
@EACH
@BOTH_KINDS
def test_dead_ends_are_left_or_reported_as_trapped_and_never_touched(avoider: str, sensors: str) -> None:
    for width, depth in [(1.6, 2.0), (2.0, 1.5), (2.4, 2.0), (3.0, 3.0), (4.0, 3.0), (5.0, 4.0)]:
        rows = [(width, depth, approach) for approach in range(20)]
        endings = all_of(dead_end, rows, sensors=sensors, avoider=avoider)
        words = told(f"dead end {width} x {depth} m, {avoider}", endings)
        assert set(words) <= {"reached", "trapped"}


@pytest.mark.slow
@EACH
@BOTH_KINDS
def test_an_obstacle_that_appears_close_ahead_is_not_touched(avoider: str, sensors: str) -> None:
    endings = all_of(sudden, [(seed,) for seed in range(30)], sensors=sensors, avoider=avoider)
    assert set(told(f"sudden, {avoider}, {sensors}", endings)) <= {"reached", "trapped"}


@pytest.mark.slow
@EACH
def test_as_printed_fields_are_crossed(avoider: str) -> None:
    words = told(f"as printed, {avoider}", all_of(field, [(seed,) for seed in range(24)], avoider=f"{avoider}@printed"))
    assert words["reached"] >= 22


@pytest.mark.slow
@EACH
def test_with_poor_sensors_it_is_no_worse_than_the_readme_states(avoider: str) -> None:
    """The limits in the README: the figures are no worse than stated there."""
    rows = [(seed,) for seed in range(24)]
    pairs = told(f"fields, pairs, {avoider}", all_of(field, rows, sensors=PAIRS, avoider=avoider))
    assert pairs["contact"] <= 8
    mirrors = told(f"fields, mirrors, {avoider}", all_of(field, rows, sensors=MIRRORS, avoider=avoider))
    assert mirrors["contact"] == 0
