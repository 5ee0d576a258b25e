"""Whole drives by reading: what changes with each of the paper's gaps, with numbers that can be checked by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from navloom_hoang2013.drive_readings import DOORS, KEYS, OFFS
from navloom_hoang2013.errata import length_of
from navloom_hoang2013.plates import Reproduction
from navloom_hoang2013.runs import away_from, box, moving_speeds
from navloom_hoang2013.seeds import LEVELS, PARAMETERS, calibrations, driven
from navloom_hoang2013.strips import FRAMES, moments_of
from navloom_lyapunov_tracker.law import tracking_error


def test_errors_change_as_eq_5_says() -> None:
    robot, reference = np.array([0.2, -0.1, 0.4]), np.array([0.5, 0.3, 0.9])
    v, w, v_r, w_r, step = 0.31, -0.2, 0.27, 0.15, 1e-6

    def moved(pose: np.ndarray, speed: float, turn: float) -> np.ndarray:
        return pose + step * np.array([speed * math.cos(pose[2]), speed * math.sin(pose[2]), turn])

    before = tracking_error(*robot, *reference)
    after = tracking_error(*moved(robot, v, w), *moved(reference, v_r, w_r))
    e1, e2, e3 = before
    expected = (w * e2 - v + v_r * math.cos(e3), -w * e1 + v_r * math.sin(e3), w_r - w)
    assert (np.array(after) - np.array(before)) / step == pytest.approx(expected, abs=1e-6)


def test_distance_from_a_box_by_hand(made: Reproduction) -> None:
    obstacle = box(made.run.world, "obstacle O")  # 1.05..1.35 by 2.45..2.75
    points = np.array([[1.2, 1.45], [1.65, 3.15], [1.2, 2.6]])
    assert away_from(obstacle, points) == pytest.approx([1.0, 0.5, 0.0])


def test_with_z_of_the_sensor_the_floor_closes_the_room(made: Reproduction) -> None:
    floor, sensor = (variant.drive for variant in made.errata.heights)
    assert (length_of(floor), length_of(sensor)) == ("10.29 m, gate B", "no path")
    assert sensor.map is not None
    # The nearest floor is 0.4 / tan 5° = 4.572 m ahead; chords of its arc are a little nearer or farther.
    ends = np.hypot(*sensor.map.segments.reshape(-1, 2).T)
    assert len(ends) > 8 and np.abs(ends - 4.572).max() < 0.05


def test_counted_from_the_lowest_outline_the_plan_leads_through_b_too(made: Reproduction) -> None:
    start, lowest = (length_of(variant.drive) for variant in made.errata.anchors)
    assert start == "10.29 m, gate B" and lowest == "10.48 m, gate B"


def test_a_turn_in_place_lets_every_start_arrive_and_the_law_alone_does_not(made: Reproduction) -> None:
    arrived = {(turn.off, turn.above): turn.drive.episode.summary()["truly_reached"] for turn in made.readings.turns}
    assert all(arrived[off, 60] for off in OFFS)
    assert [off for off in OFFS if not arrived[off, 180]] == [135, 180]


def test_below_60_degrees_the_turn_in_place_changes_nothing(made: Reproduction) -> None:
    first, second = (turn.drive.episode.summary() for turn in made.readings.turns if turn.off == 30)
    assert first["path_length_m"] == second["path_length_m"]


def test_the_avoider_acts_from_less_than_half_of_4_m(made: Reproduction) -> None:
    printed, robust, wide = made.readings.ranges
    assert printed.acts_from is not None and robust.acts_from is not None and wide.acts_from is not None
    # The window of 33 cells of 0.1 m ends 1.65 m to the sides, 2.3 m at its corners.
    assert 1.6 < printed.acts_from < 2.3 and 0.9 < robust.acts_from < 1.3
    # The sonars are at the robot's front, 0.4 m before its centre, and hear up to 4 m.
    assert 4.0 < wide.acts_from < 4.4


def test_speeds_as_they_occur(made: Reproduction) -> None:
    speeds = moving_speeds(made.free)
    assert np.mean((speeds >= 0.19) & (speeds <= 0.41)) > 0.95
    assert 0.35 < np.median(speeds) <= 0.41


def test_the_strip_has_eight_frames_from_start_to_end(made: Reproduction) -> None:
    moments = moments_of(made.run)
    assert moments.shape == (FRAMES, 6) and FRAMES == 8
    assert moments[0, 1:3] == pytest.approx([0.0, 0.0]) and moments[-1, 0] == made.run.episode.recorder.truth[-1][0]
    steps = np.diff(moments[:, 0])
    assert steps.max() - steps.min() <= 0.05 + 1e-9  # a tick


def test_twenty_seeds_of_both_avoiders_touch_nothing(made: Reproduction) -> None:
    printed, robust = made.readings.tallies
    assert [len(tally.results) for tally in (printed, robust)] == [20, 20]
    assert printed.touched == robust.touched == 0
    assert printed.believed == robust.believed == 20 and min(printed.reached, robust.reached) >= 17
    # Robust counts the robot's width, printed does not: it passes O three times as far away.
    assert printed.median("clearance") < 0.2 < 0.35 < robust.median("clearance")


def test_both_methods_as_printed_meet_four_doors(made: Reproduction) -> None:
    doors = {(door.method, door.width): door for door in made.readings.doors}
    assert len(doors) == 2 * len(DOORS)
    assert doors["Improved VFH", 2.4].passed and not doors["virtual forces", 1.2].passed


def test_each_printed_key_is_driven_alone(made: Reproduction) -> None:
    assert [variant.name for variant in made.readings.alone] == list(KEYS)
    assert {"avoider.reset_scope=window", "avoider.distance_from=centre", "avoider.enlargement=none"} <= set(KEYS)


def test_law_6_copes_with_wrong_wheels_only_if_odometry_knows_them() -> None:
    room, wrong = "world.ref=paper_gates", "platform.wheel_radius_error=-0.1"
    seeds = range(3)
    blind = driven("", room, wrong, seeds=seeds)
    known = driven("", room, wrong, "platform.odometry_right_radius_error=-0.1",
                   "platform.odometry_left_radius_error=-0.1", seeds=seeds)  # fmt: skip
    # Of 9.4 m that odometry counts, wheels 10 % smaller drive 8.5 m. The robot believes that it arrived either way.
    assert (blind.believed, blind.reached) == (3, 0) and blind.median("goal_error") > 0.4
    assert known.reached >= 2 and known.median("goal_error") < 0.3


@pytest.mark.slow
def test_the_docs_state_what_the_campaign_gives() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "lab" / "paper-results.md").read_text("utf-8")
    found = {(entry.parameter, entry.error, entry.knows): entry.tally for entry in calibrations(lambda text: None)}
    for level in LEVELS:
        tallies = [found[parameter, level, knows] for parameter, _ in PARAMETERS for knows in (False, True)]
        cells = " | ".join(f"{tally.reached} ({tally.median('goal_error'):.2f} m)" for tally in tallies)
        assert f"| {100.0 * level:{'+' if level else ''}.0f} % | {cells} |" in page, level
    assert all(tally.believed == 20 and tally.touched == 0 for tally in found.values())
