"""Metrics of robots among people, on drives whose numbers can be worked out by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from navloom import Cylinder, Trail, World
from navloom.config import load_config
from navloom.geometry.footprints import disc, rectangle
from navloom.messages import Bodies, Tracks
from navloom.runs.episode_recorder import streams_of
from navloom.runs.episode_trail import lost_trail
from navloom.runs.metrics import measure
from navloom.runs.moving_bodies import moving_bodies
from navloom.runs.tracking import tracking_of
from numpy.typing import NDArray

Floats = NDArray[np.float64]
DISC = disc(0.25)
TIME = np.arange(0.0, 10.01, 0.05)


Person = tuple[tuple[float, float, float], ...]


def person(*waypoints: tuple[float, float, float]) -> Person:
    """Time, s, x, y, m, of somebody who walks straight from one to the next."""
    return waypoints


def told(people: Sequence[Person]) -> list[Bodies]:
    """What the world tells in each tick: discs of 0.3 m, and the robot, which is none of them."""
    names, robot = (*(f"person {k}" for k in range(len(people))), "robot"), (0.0, 0.0, 0.0)
    rows = []
    for time in TIME.tolist():
        at = [[np.interp(moment, *np.array(one).T[[0, axis]]) for one in people for axis in (1, 2)]
              for moment in (time, time + 1e-6)]  # fmt: skip
        now, then = (np.array(row).reshape(-1, 2) for row in at)
        poses = np.vstack([np.column_stack([now, np.zeros(len(now))]), robot])
        speeds = np.vstack([np.column_stack([(then - now) / 1e-6, np.zeros(len(now))]), robot])
        parts = np.array([(k, x, y, 0.3, 0.0, 0.0, 0.0, 1.8, 0.0) for k, (x, y) in enumerate(now)]).reshape(-1, 9)
        rows.append(Bodies(round(1e9 * time), names, poses, speeds, parts, 1))
    return rows


def standing(
    *people: Person, pillars: Sequence[Cylinder] = (), footprint: Floats = DISC, messages: Any = (), speed: float = 0.0
) -> Trail:
    """The trail of a robot that drives along x from the origin for 10 s, among people and pillars."""
    world, zeros = World("made", tuple(pillars)), 0.0 * TIME
    bodies = moving_bodies(told(people), TIME)
    x = speed * TIME
    streams = {("people", "tracks"): tuple((one.stamp_ns * 1e-9, one) for one in messages)} if messages else {}
    arrays: dict[str, Any] = {"time": TIME, "x": x, "y": zeros, "heading": zeros, "vx": zeros + speed, "wz": zeros}
    kept = lost_trail("succeeded", "", period=0.05, limit=60.0, max_linear=1.0, max_deceleration=1.0, reaction=0.1)
    more = {
        "footprint": footprint, "bodies": bodies, "streams": streams, "clearance": zeros + 1.0, "cross_track": zeros,
        "command_vx": zeros, "command_wz": zeros, "engaged": zeros > 1.0, "stopped_by_gate": zeros > 1.0,
        "tracking": tracking_of(streams, bodies, np.stack([TIME, x, zeros], 1), world, 1.0),
    }  # fmt: skip
    return Trail(**{**vars(kept), **arrays, **more})


def tracks(time: float, *rows: tuple[int, float, float, float, float]) -> Tracks:
    """A message with (id, x, y, vx, vy) of each track."""
    given = np.array(rows, dtype=np.float64).reshape(-1, 5)
    count = len(given)
    return Tracks(round(time * 1e9), given[:, 0].astype(np.int64), given[:, 1:3].copy(), given[:, 3:].copy(),
                  np.zeros((count, 4, 4)), np.full(count, 0.3), np.zeros(count))  # fmt: skip


PASSES = person((0.0, -5.0, 0.55), (10.0, 5.0, 0.55))
"""Walks past the origin at 1 m/s, 0.55 m to the left: 0.3 m from a disc of 0.25 m, after 5 s."""


def test_distances_are_from_the_footprint_to_the_centre_of_the_person() -> None:
    found = measure(standing(PASSES))
    assert found["person_distance_min"] == pytest.approx(0.3, abs=0.001)
    # Within 0.45 m of the outline: 2 √(0.7² - 0.55²) s at 1 m/s; within 1.2 m: 2 √(1.45² - 0.55²) s.
    inner, outer = 2.0 * np.sqrt(0.7**2 - 0.55**2), 2.0 * np.sqrt(1.45**2 - 0.55**2)
    assert found["intimate_time"] == pytest.approx(inner, abs=0.03)
    assert found["personal_time"] == pytest.approx(outer - inner, abs=0.03)
    assert 0.05 < float(found["intimate_depth"] or 0.0) < 0.15
    assert found["speed_near_people"] == 0.0


def test_the_sides_of_a_rectangle_are_its_outline() -> None:
    assert measure(standing(PASSES, footprint=rectangle(1.0, 0.2)))["person_distance_min"] == pytest.approx(0.45)


def test_the_time_to_collision_is_that_of_discs_at_constant_velocities() -> None:
    """From 5 m at 0.5 m/s towards a robot of 0.5 m/s; they touch at 0.55 m. After 3 s of 4.45 s the person stops."""
    ahead = person((0.0, 5.0, 0.0), (3.0, 3.5, 0.0), (3.05, 3.5, 0.0))
    assert measure(standing(person((0.0, 5.0, 0.0), (9.0, 5.0, 4.5)), speed=0.0))["time_to_collision_min"] is None
    found = measure(standing(ahead, speed=0.1))["time_to_collision_min"]
    # Then 3.5 - 0.3 - 0.55 m at 0.6 m/s; later 3.5 - 1.0 - 0.55 m at 0.1 m/s is longer.
    assert found == pytest.approx((3.5 - 0.3 - 0.55) / 0.6, abs=0.1)


def test_without_people_the_metrics_are_undefined_and_not_0() -> None:
    found = measure(standing(pillars=[Cylinder("pillar", 1.0, 0.0, 0.2)]))
    names = [name for name in found if name.startswith(("person", "intimate", "track_"))] + ["speed_near_people"]
    assert len(names) == 11 and all(found[name] is None for name in names)


def test_ospa_velocity_and_latency_of_tracks_beside_a_person() -> None:
    """For 5 s none of the person who stands 3 m ahead; then 0.2 m beside it, at 0.3 m/s; and one of nothing."""
    messages = [tracks(0.1 * k, *([(1, 3.0, 0.2, 0.0, 0.3)] if k >= 50 else [])) for k in range(100)]
    found = measure(standing(person((0.0, 3.0, 0.0), (20.0, 3.0, 0.0)), messages=messages))
    assert found["track_ospa"] == pytest.approx(0.5 * 1.0 + 0.5 * 0.2)
    assert found["track_ospa_location"] == pytest.approx(0.1) and found["track_ospa_cardinality"] == pytest.approx(0.5)
    assert found["track_latency"] == pytest.approx(5.0) and found["track_speed_rms"] == pytest.approx(0.3)
    assert found["false_tracks"] == 0.0


def test_a_track_of_nothing_is_false_and_one_of_who_is_hidden_is_not() -> None:
    wall = Cylinder("pillar", 2.0, 0.0, 0.5)
    hidden = person((0.0, 4.0, 0.0), (20.0, 4.0, 0.0))
    messages = [tracks(0.1 * k, (1, 4.0, 0.1, 0.0, 0.0), (2, -3.0, 0.0, 0.0, 0.0)) for k in range(100)]
    trail = standing(hidden, pillars=[wall], messages=messages)
    assert [one.ids.tolist() for one in trail.tracking.moments] == [[2]] * 100
    assert measure(trail)["false_tracks"] == pytest.approx(60.0 / 9.9)


def test_metrics_that_read_a_node_read_every_node_of_the_config() -> None:
    nodes = 'node=[{ name = "left", plugin = "a" }, { name = "right", plugin = "b" }]'
    config = load_config("paper", (nodes,)).config
    assert streams_of([("node", "tracks"), ("gate", "status")], config) == {
        ("left", "tracks"), ("right", "tracks"), ("gate", "status"),
    }  # fmt: skip
