"""Closed loop in lockstep on the simulated robot: clutter, doors and BARN worlds. No contact."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import avoider_drives
import numpy as np
import pytest
from avoider_drives import BARN, BOTH_KINDS, BOUNDS, LASER, UP, all_of, told, way_past
from navloom import Place, World
from navloom.config import load_config
from navloom.runs import run_episode

NEEDS_BARN = pytest.mark.skipif(not BARN.is_file(), reason="NAVLOOM_DATA names no folder with barn/barn_dev.npz")
drive, field = partial(avoider_drives.drive, avoider="mppi"), partial(avoider_drives.field, avoider="mppi")
door, sudden = partial(avoider_drives.door, avoider="mppi"), partial(avoider_drives.sudden, avoider="mppi")
barn = partial(avoider_drives.barn, avoider="mppi")


def test_a_field_is_crossed_without_a_stop() -> None:
    """15 m at 0.5 m/s are 30 s."""
    ending = field(1, sensors=LASER)
    assert ending.word == "reached"
    assert ending.seconds < 36.0
    assert ending.gap > 0.05


def test_with_a_laser_a_door_with_10_cm_on_either_side_is_passed() -> None:
    ending = door(1.0, 0, sensors=LASER)
    assert way_past(ending) == "through"
    assert ending.gap > 0.03


def test_the_goal_is_driven_to_and_not_past() -> None:
    world = World("open", (), bounds=BOUNDS)
    ending = drive(world, Place(0.0, 0.0, UP), Place(0.0, 4.0), 1, settings=["navigation.goal_tolerance=0.1"])
    assert ending.word == "reached"
    assert ending.track[:, 1].max() < 4.05
    assert np.abs(ending.track[:, 0]).max() < 0.1


def test_the_same_seed_gives_the_same_drive() -> None:
    np.testing.assert_array_equal(door(1.6, 8, sensors=LASER).track, door(1.6, 8, sensors=LASER).track)


@NEEDS_BARN
@pytest.mark.parametrize("number", [7, 241])
def test_a_barn_world_is_crossed_as_explore_ships(number: int) -> None:
    """10 m in less than 10 s: the score is then 0.5, the highest."""
    settings = [f'world.ref="barn:{Path(BARN).resolve()}#{number}"', 'avoider.plugin="mppi"']
    found = run_episode(load_config("explore", settings)).summary()
    assert (found["truly_reached"], found["collisions"]) == (True, 0)
    assert found["sim_time_s"] < 14.0


@pytest.mark.slow
@BOTH_KINDS
def test_at_least_45_of_50_fields_are_crossed_and_none_with_contact(sensors: str) -> None:
    words = told(f"fields, {sensors}", all_of(field, [(seed,) for seed in range(50)], sensors=sensors))
    assert set(words) <= {"reached", "trapped", "timeout"}
    assert words["reached"] >= 45


@pytest.mark.slow
def test_an_obstacle_that_appears_close_ahead_is_not_touched() -> None:
    words = told("sudden", all_of(sudden, [(seed,) for seed in range(30)], sensors=LASER))
    assert words["contact"] == 0


@pytest.mark.slow
@NEEDS_BARN
def test_barn_worlds() -> None:
    words = told("BARN", all_of(barn, [(number,) for number in range(1, 300, 6)]))
    assert words["contact"] == 0
    assert words["reached"] >= 45
