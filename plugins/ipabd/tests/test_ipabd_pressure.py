"""The fused pass: its rules by hand, and equality with the plain numpy pipeline."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_ipabd.pressure import Barriers, press
from navloom_ipabd.pressure_numpy import press_numpy, union
from navloom_ipabd.rules import Filters, Rule
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import FrameMotion, standing

PITCHES_DEG = [-10.0, 0.0, 10.0, 20.0]


def counts_of(barriers: Barriers) -> dict[str, int]:
    return {rule.name.lower(): number for rule, number in barriers.counts.items() if number}


def test_every_rule_once(make_image) -> None:
    # Frame 0 is level (z = 0.4 everywhere), frame 1 looks down 30° (z = 0.4 - R/2), frame 2 up 30° (z = 0.4 + R/2).
    image = make_image(
        [[math.inf, 79.96, 0.02, 5.0], [5.0, 0.8, 1.0, math.inf], [2.0, math.inf, 1.0, 3.0]],
        pitches_deg=[0.0, -30.0, 30.0],
        range_min=0.1,
    )
    barriers = press(image, Filters(floor_tolerance=0.06, z_limit=1.2))
    assert counts_of(barriers) == {
        "no_return": 3,
        "beyond_max": 1,  # 79.96 >= 80 - 0.05
        "below_min": 1,  # 0.02 < 0.1
        "below_floor": 2,  # z = -2.1 and -0.1
        "floor": 1,  # z = 0.0
        "too_high": 2,  # z = 1.4 and 1.9
        "kept": 2,  # 5.0 level and 1.0 up (z = 0.9)
    }
    assert barriers.ranges[[2, 3]] == pytest.approx([math.cos(math.pi / 6), 5.0])
    assert np.isinf(barriers.ranges[[0, 1]]).all()


def test_the_minimum_is_of_horizontal_range(make_image) -> None:
    # 2.0 m level against 2.05 m at 20°, which is only 1.926 m away on the floor.
    barriers = press(make_image([[2.0], [2.05]], pitches_deg=[0.0, 20.0]), Filters())
    assert barriers.ranges[0] == pytest.approx(2.05 * math.cos(math.radians(20.0)))
    assert barriers.points[0] == pytest.approx([1.926370, 0.0, 0.4 + 0.701141], abs=1e-6)
    assert counts_of(barriers) == {"not_minimum": 1, "kept": 1}


def test_the_printed_order_loses_the_wall_behind_the_floor(make_image) -> None:
    image = make_image([[2.0], [5.0]], pitches_deg=[-11.537, 0.0])  # floor at 1.96 m, wall at 5 m
    assert counts_of(press(image, Filters())) == {"floor": 1, "kept": 1}
    printed = press(image, Filters(order="paper"))
    assert counts_of(printed) == {"floor": 1, "not_minimum": 1}
    assert np.isinf(printed.ranges).all()


def test_limits_of_height(make_image) -> None:
    # 30° up: z = 0.4 + R/2. R = 1.6 gives z = 1.2, exactly the limit, and is kept; the floor band is closed too.
    filters = Filters(floor_tolerance=0.25, z_limit=1.2)
    up = press(make_image([[1.6, 1.602]], pitches_deg=[30.0], mount=(0.0, 0.0, 0.4)), filters)
    assert counts_of(up) == {"too_high": 1, "kept": 1}
    level = press(make_image([[1.0]], mount=(0.0, 0.0, 0.25)), filters)
    assert counts_of(level) == {"floor": 1}


def test_seen_ends_at_the_obstacle_or_at_the_last_return(make_image) -> None:
    image = make_image([[3.0, math.inf, math.inf], [5.0, 6.0, math.inf]], pitches_deg=[0.0, 30.0])
    assert press(image, Filters()).seen == pytest.approx([3.0, 6.0 * math.cos(math.pi / 6), 0.0])


def test_a_rigid_pitch_moves_a_beam_to_another_azimuth(make_image) -> None:
    # b = 40°, α = 60°: azimuth atan(tan 40° / cos 60°) = 59.21°: the bin of 59° on the whole circle.
    image = make_image([[math.inf, 0.9]], pitches_deg=[60.0], bearings_deg=[39.0, 40.0], geometry="rigid_pitch")
    barriers = press(image, Filters())
    kept = np.flatnonzero(np.isfinite(barriers.ranges))
    assert np.degrees(barriers.bins.azimuths[kept]) == pytest.approx([59.0])
    assert math.degrees(math.atan2(barriers.points[kept[0], 1], barriers.points[kept[0], 0])) == pytest.approx(
        59.2106, abs=1e-3
    )
    assert barriers.bins.size == 360


def test_bin_width_coarsens(make_image) -> None:
    image = make_image([[5.0, 4.0, 6.0, 7.0]], bearings_deg=[0.0, 0.5, 2.0, 2.5])
    barriers = press(image, Filters(), bin_width=math.radians(2.0))
    assert barriers.bins.size == 180
    assert np.sort(barriers.ranges)[:2] == pytest.approx([4.0, 6.0])  # bins centred on 0° (-1..1) and 2° (1..3)
    assert barriers.counts[Rule.KEPT] + barriers.counts[Rule.NOT_MINIMUM] == 4


def test_the_union_keeps_all_obstacle_pixels_with_their_height(make_image) -> None:
    image = make_image([[2.0, math.inf], [2.05, 9.0]], pitches_deg=[0.0, 20.0])
    assert union(image, Filters()) == pytest.approx(np.array([[2.0, 0.0, 0.4], [1.926370, 0.0, 1.101141]]), abs=1e-6)


def test_with_z_of_eq_1_the_floor_is_an_obstacle_and_the_level_of_the_sensor_is_not(make_image) -> None:
    # The sensor is 0.4 m up. Level: z = 0 in its frame. 11.537° down at 2 m: the floor, z = -0.4. Up 30° at 1.6 and at
    # 2.5 m: z = 0.8 and 1.25, so that the second is above 1.2, although the robot ends 0.8 m above its sensor.
    image = make_image([[5.0, 5.0], [2.0, 5.0], [1.6, 2.5]], pitches_deg=[0.0, -11.537, 30.0])
    printed = press(image, Filters(frame="sensor"))
    assert counts_of(printed) == {"floor": 2, "too_high": 1, "not_minimum": 1, "kept": 2}
    assert printed.points[0] == pytest.approx([1.6 * math.cos(math.pi / 6), 0.0, 1.2], abs=1e-9)
    assert printed.points[1, 2] == pytest.approx(0.4 - 5.0 * math.sin(math.radians(11.537)))
    assert counts_of(press(image, Filters(frame="sensor", order="paper")))["kept"] == 1  # 2.165 m, z = 1.25, removed


def random_image(seed: int, geometry: str, beams: int) -> SweepImage:
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.0, 6.0, (len(PITCHES_DEG), beams))
    ranges[rng.random(ranges.shape) < 0.2] = math.inf
    ranges[rng.random(ranges.shape) < 0.1] = 6.1
    bearings = np.radians(-20.0 + 1.7 * np.arange(beams))
    times = 0.05 * np.arange(len(PITCHES_DEG))
    return SweepImage(ranges, np.radians(PITCHES_DEG), times, bearings, (0.1, 0.0, 0.5), 0.2, 6.12, geometry)


def moved(seed: int) -> FrameMotion:
    rng = np.random.default_rng(seed)
    return FrameMotion(rng.uniform(-0.3, 0.3, (4, 2)), rng.uniform(-0.5, 0.5, 4), (0.0, 0.0, 0.0))


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    beams=st.integers(1, 30),
    geometry=st.sampled_from(["paper", "rigid_pitch"]),
    order=st.sampled_from(["before_min", "paper"]),
    frame=st.sampled_from(["floor", "sensor"]),
    is_moving=st.booleans(),
)
def test_fused_equals_numpy_and_counts_sum(
    seed: int, beams: int, geometry: str, order: str, frame: str, is_moving: bool
) -> None:
    image, filters = random_image(seed, geometry, beams), Filters(order=order, frame=frame)
    motion = moved(seed) if is_moving else standing(4, (0.0, 0.0, 0.0))
    fused, plain = press(image, filters, motion), press_numpy(image, filters, motion)
    assert fused.counts == plain.counts
    assert sum(fused.counts.values()) == 4 * beams
    np.testing.assert_allclose(fused.ranges, plain.ranges, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(fused.points, plain.points, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(fused.seen, plain.seen, rtol=0.0, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_columns_and_bins_find_the_same_barriers(seed: int) -> None:
    image = random_image(seed, "paper", 25)
    columns, bins = press(image, Filters()), press(image, Filters(), bin_width=image.bearing_step)
    assert columns.counts == bins.counts
    np.testing.assert_allclose(bins.ranges[:25], columns.ranges, rtol=0.0, atol=1e-12)
    assert np.isinf(bins.ranges[25:]).all()


def test_a_single_beam_has_a_bin_of_one_degree() -> None:
    image = SweepImage(np.ones((1, 1)), np.zeros(1), np.zeros(1), np.zeros(1), (0.0, 0.0, 0.4), 0.0, 80.0)
    assert math.degrees(image.bearing_step) == pytest.approx(1.0)
