"""Worlds of others in which something moves: DynaBARN and recorded people."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom.geometry.world import Place
from navloom.worlds import WorldError
from navloom_maps import dynabarn_world, people_world

KEYS = [
    (0.0, 0.0, 0.0),
    (2.0, 2.0, 0.0),
    (4.0, 0.0, 0.0),
    (0.0, 5.0, 5.0),
    (1.0, 6.0, 5.0),
    (0.0, 1.0, 1.0),
    (2.0, 3.0, 1.0),
]
DYNABARN: dict[str, Any] = {
    "world": np.array([1, 3]), "world_off": np.array([0, 1, 3]), "radius": np.array([0.5, 0.4, 0.3]),
    "period_s": np.array([4.0, 1.0, 2.0]), "key_off": np.array([0, 3, 5, 7]), "keys": np.array(KEYS),
}  # fmt: skip
PEOPLE: dict[str, Any] = {
    "hall_t": np.array([0.0, 0.4, 0.4, 0.8, 0.8, 5.0]), "hall_id": np.array([1, 1, 2, 1, 2, 3]),
    "hall_xy": np.array([(0, 0), (0.4, 0), (3, 3), (1.2, 0), (3, 2), (9, 9)], dtype=float),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    np.savez_compressed(tmp_path / "d.npz", **DYNABARN)
    np.savez_compressed(tmp_path / "p.npz", **PEOPLE)
    return tmp_path


def test_a_dynabarn_world_has_its_own_obstacles_and_the_organisers_task(folder: Path) -> None:
    world = dynabarn_world("d.npz#3", folder)
    assert [actor.body.radius for actor in world.actors] == [0.4, 0.3]
    assert (world.start, world.goal) == (Place(11.0, 0.0, math.pi), Place(-9.0, 0.0))
    assert (world.goal_tolerance, world.time_limit) == (1.0, 100.0)
    assert world.actors[1].course.at(1.0)[:2] == (2.0, 1.0)


def test_the_phase_is_the_time_that_the_obstacles_have_moved_before(folder: Path) -> None:
    """A period of 4 s: at 0.5 s with a phase of 7.5 s it is at 8 s, as at 4 s, where it arrives at (0, 0)."""
    (obstacle,) = dynabarn_world("d.npz#1@7.5", folder).actors
    assert obstacle.course.at(0.25)[:2] == pytest.approx((0.25, 0.0))
    assert obstacle.course.at(1.5)[:2] == pytest.approx((1.0, 0.0))


def test_key_frames_can_be_read_as_the_organisers_simulator_does(folder: Path) -> None:
    (obstacle,) = dynabarn_world("d.npz#1?keys=gazebo", folder).actors
    # Closed: the slopes at the first and at the second key frame are 0.5 * (2 - 2) and 0.5 * (0 - 0).
    assert obstacle.course.at(0.5).x == pytest.approx(2.0 * 0.0625 * (3.0 - 0.5))


def test_recorded_people_are_there_between_their_samples(folder: Path) -> None:
    world = people_world("p.npz#hall", folder)
    first, second = world.actors  # the third has one sample, which says nothing of a way
    assert first.body.kind == "legs" and first.course.at(0.6)[:2] == pytest.approx((0.8, 0.0))
    assert first.course.at(0.6)[3:5] == pytest.approx((2.0, 0.0))
    assert [second.course.at(time) is not None for time in (0.39, 0.4, 0.8, 0.81)] == [False, True, True, False]


def test_a_scene_can_begin_later(folder: Path) -> None:
    first, _ = people_world("p.npz#hall@0.6", folder).actors
    assert first.course.at(0.0)[:2] == pytest.approx((0.8, 0.0)) and first.course.at(0.3) is None


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("d.npz#2", "there is no world 2; the file has 1, 3"),
        ("d.npz", "expected a world's number, as in dynabarn:d.npz#3@7.5"),
        ("d.npz#1@x", "'x' after '@', expected a time from 0"),
        ("d.npz#1@nan", "'nan' after '@', expected a time from 0"),
        ("d.npz#1?keys=cubic", "keys=cubic"),
        ("e.npz#1", "there is no such file; did you mean 'p.npz'"),
    ],
)
def test_a_wrong_dynabarn_reference_is_explained(folder: Path, argument: str, said: str) -> None:
    with pytest.raises(WorldError) as raised:
        dynabarn_world(argument, folder)
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("p.npz", "expected a scene after '#', as in people:p.npz#hotel@12.5"),
        ("p.npz#hal", "there is no scene 'hal'; did you mean 'hall'"),
        ("p.npz#hall@9", "nobody is in hall from 9 s on; it ends at 5 s"),
        ("p.npz#hall@-1", "'-1' after '@', expected a time from 0"),
        ("p.npz#hall?body=leg", "body=leg"),
    ],
)
def test_a_wrong_people_reference_is_explained(folder: Path, argument: str, said: str) -> None:
    with pytest.raises(WorldError) as raised:
        people_world(argument, folder)
    assert said in str(raised.value)


def test_damaged_arrays_are_refused(folder: Path) -> None:
    for change, said in (
        ({"key_off": np.array([0, 3, 5])}, "obstacles 0 to 1 of world 1, of 3 radii"),
        ({"keys": np.array(KEYS)[::-1]}, "at times from 0 that rise"),
        ({"radius": np.array([0.0, 0.4, 0.3])}, "a radius > 0"),
    ):
        np.savez_compressed(folder / "d.npz", **{**DYNABARN, **change})
        with pytest.raises(WorldError, match=said):
            dynabarn_world("d.npz#1", folder)
    np.savez_compressed(folder / "p.npz", **{**PEOPLE, "hall_t": np.zeros(6)})
    with pytest.raises(WorldError, match="person 1 of hall has two samples at one time"):
        people_world("p.npz#hall", folder)
