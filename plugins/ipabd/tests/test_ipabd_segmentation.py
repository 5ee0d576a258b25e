"""The four point-distance thresholds, by hand and on walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom_ipabd.errors import SettingError
from navloom_ipabd.segmentation import (
    Segmentation,
    adaptive_threshold,
    dietmayer_threshold,
    lee_ratio,
    santos_threshold,
    segment_starts,
)

DEGREE = math.radians(1.0)


def wall(incidence_deg: float, bearings_deg: np.ndarray, distance: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """Points and ranges on a line `distance` away whose normal lies at 90° - incidence from bearing 0."""
    normal = math.radians(90.0 - incidence_deg)
    ranges = distance / np.cos(np.radians(bearings_deg) - normal)
    return np.column_stack([ranges * np.cos(np.radians(bearings_deg)), ranges * np.sin(np.radians(bearings_deg))]), (
        ranges
    )


def objects(points: np.ndarray, ranges: np.ndarray, **settings: object) -> int:
    return segment_starts(points, ranges, np.arange(ranges.size), DEGREE, Segmentation(**settings)).size - 1


def test_adaptive_threshold_by_hand() -> None:
    # 5 sin1° / sin9° + 3 * 0.02 = 5 * 0.01745241 / 0.15643447 + 0.06
    assert adaptive_threshold(np.array([5.0]), DEGREE, math.radians(10.0), 0.02) == pytest.approx([0.617818], abs=1e-6)


def test_dietmayer_threshold_by_hand() -> None:
    # 0.1 + 5 * 2 sin(0.5°)
    assert dietmayer_threshold(np.array([5.0]), DEGREE, 0.1) == pytest.approx([0.187265], abs=1e-6)


def test_santos_threshold_by_hand() -> None:
    # chord 0.0872653 / (cot15° (cos0.5° - sin0.5°)) = 0.0872653 / (3.7320508 * 0.9912354) = 0.0235898
    got = santos_threshold(np.array([5.0]), DEGREE, 0.1, math.radians(15.0))
    assert got == pytest.approx([0.123590], abs=1e-6)


def test_lee_ratio_by_hand() -> None:
    assert lee_ratio(np.array([6.0]), np.array([4.0])) == pytest.approx([0.2])


def test_dietmayer_with_small_c0_shatters_oblique_walls_at_one_degree() -> None:
    points, ranges = wall(20.0, np.arange(-10.0, 40.0))  # the first twenty beams meet it at 10° to 29°
    shattered = objects(points[:20], ranges[:20], method="dietmayer", noise=0.02)
    assert shattered == 20
    assert objects(points[:20], ranges[:20], method="adaptive") == 1


def test_dietmayer_keeps_a_wall_met_squarely() -> None:
    points, ranges = wall(90.0, np.arange(-10.0, 11.0))
    assert objects(points, ranges, method="dietmayer", noise=0.02) == 1


@pytest.mark.parametrize(("method", "expected"), [("adaptive", 2), ("dietmayer", 2), ("santos", 2), ("lee", 2)])
def test_every_method_parts_a_step_of_two_metres(method: str, expected: int) -> None:
    bearings = np.radians(np.arange(-10.0, 10.0))
    ranges = np.where(np.arange(20) < 10, 3.0, 5.0)
    points = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])
    assert objects(points, ranges, method=method) == expected


def test_lee_is_blind_to_a_gap_at_equal_range_but_missing_columns_are_not() -> None:
    bearings = np.radians([0.0, 1.0, 31.0, 32.0])
    points, ranges = np.column_stack([3.0 * np.cos(bearings), 3.0 * np.sin(bearings)]), np.full(4, 3.0)
    side_by_side = np.arange(4)
    assert segment_starts(points, ranges, side_by_side, DEGREE, Segmentation("lee")).tolist() == [0, 4]
    apart = np.array([0, 1, 31, 32])
    assert segment_starts(points, ranges, apart, DEGREE, Segmentation("lee")).tolist() == [0, 2, 4]


def test_missing_columns_count_as_distance_up_to_the_limit() -> None:
    bearings, ranges = np.radians([0.0, 3.0]), np.full(2, 3.0)  # 0.157 m apart, threshold 0.395 m
    points = np.column_stack([3.0 * np.cos(bearings), 3.0 * np.sin(bearings)])
    columns = np.array([0, 3])
    assert segment_starts(points, ranges, columns, DEGREE, Segmentation(max_missing=2)).tolist() == [0, 2]
    assert segment_starts(points, ranges, columns, DEGREE, Segmentation(max_missing=1)).tolist() == [0, 1, 2]


def test_no_points_no_objects() -> None:
    starts = segment_starts(np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=np.int64), DEGREE, Segmentation())
    assert starts.tolist() == [0]


def test_an_incidence_below_the_step_is_refused() -> None:
    with pytest.raises(SettingError, match=r"incidence: got 1° with a bearing step of 2°"):
        adaptive_threshold(np.array([1.0]), math.radians(2.0), DEGREE, 0.02)


def test_an_incidence_of_nearly_90_degrees_is_accepted() -> None:
    """2 sin 1 / sin 84 = 0.0351 m."""
    step, incidence = math.radians(1.0), math.radians(85.0)
    assert adaptive_threshold(np.array([2.0]), step, incidence, 0.0) == pytest.approx(0.0351, abs=1e-4)
    with pytest.raises(SettingError, match="90"):
        adaptive_threshold(np.array([2.0]), step, math.radians(90.0), 0.0)
