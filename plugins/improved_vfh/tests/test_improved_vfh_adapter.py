"""The plugin and the framework's contract."""

import math

import numpy as np
import pytest
from avoider_scans import given, laser, make, sonars
from navloom import Claim, Discovery, Twist2D
from navloom_check.behaviour.behaviour_tier import claims_of
from navloom_improved_vfh import avoidance
from navloom_improved_vfh.adapter import ImprovedVfh
from navloom_improved_vfh.params import ImprovedVfhParams
from pydantic import ValidationError


@pytest.fixture
def avoider():
    return make(ImprovedVfh)


def test_is_found_by_its_entry_point():
    assert Discovery().role("avoider", "improved_vfh") is ImprovedVfh


def test_the_check_requires_its_role_its_footprint_and_the_mirror():
    assert claims_of(ImprovedVfh) == {Claim.NO_CONTACT, Claim.REACHES, Claim.FOOTPRINT, Claim.MIRROR}


def test_free_way_is_clear_and_driven_at_full_speed(avoider):
    answer = avoider.avoid(given(sonars([math.inf] * 8)))
    assert (answer.status, answer.twist) == ("clear", Twist2D(0.5, 0.0, 0.0))
    assert answer.diagnostics.chosen == 0.0


@pytest.mark.parametrize("sensor", ["sonar", "laser"])
def test_obstacle_ahead_is_steered_round(avoider, sensor):
    scan = sonars([math.inf, math.inf, 0.6, 0.5, 0.5, 0.6, math.inf, math.inf])
    if sensor == "laser":
        scan = laser(np.where(np.abs(np.linspace(-1.5, 1.5, 101)) < 0.3, 0.9, math.inf))
    answer = avoider.avoid(given(scan))
    assert answer.status == "steering"
    assert abs(answer.twist.wz) == pytest.approx(math.radians(25.0))
    assert answer.twist.vx == 0.0
    assert answer.diagnostics.window.max() == 3
    assert abs(answer.diagnostics.chosen) > math.radians(45.0)


def test_all_sides_blocked_is_typed_trapped_after_the_attempts(avoider):
    """Four rotations of 100 degrees at 25 deg/s take 16 s; the fifth would be one too many."""
    near, heading = sonars([0.45] * 8), 0.0
    ticks = 0
    while (answer := avoider.avoid(given(near, heading=heading))).status != "trapped" and ticks < 400:
        ticks += 1
        heading = (heading + 0.05 * answer.twist.wz + math.pi) % (2.0 * math.pi) - math.pi
    assert answer.status == "trapped"
    assert answer.twist == Twist2D(0.0, 0.0, 0.0)
    assert answer.diagnostics.why == "trapped: no slot in 4 rotations without progress"
    assert ticks * 0.05 == pytest.approx(16.0, abs=0.5)


def test_reset_forgets_the_window_and_the_trap(avoider):
    for _ in range(200):
        avoider.avoid(given(sonars([0.35] * 8)))
    avoider.reset()
    answer = avoider.avoid(given(sonars([math.inf] * 8)))
    assert answer.status == "clear"
    assert answer.diagnostics.window.sum() == 0


def test_a_tick_without_scans_keeps_the_obstacles(avoider):
    seen = avoider.avoid(given(sonars([math.inf, math.inf, 0.6, 0.5, 0.5, 0.6, math.inf, math.inf])))
    after = avoider.avoid(given())
    np.testing.assert_array_equal(after.diagnostics.window, seen.diagnostics.window)


def test_laser_above_a_low_obstacle_does_not_hide_it_from_the_sonars(avoider):
    low = sonars([math.inf, math.inf, math.inf, 0.5, 0.5, math.inf, math.inf, math.inf])
    answer = avoider.avoid(given(low, laser(np.full(101, math.inf))))
    assert answer.diagnostics.window.max() == 3
    assert answer.status == "steering"


def test_window_in_the_map_frame_follows_the_robot(avoider):
    answer = avoider.avoid(given(sonars([math.inf] * 8), x=2.05))
    assert answer.diagnostics.window_x == pytest.approx(2.0 - 1.6)
    assert answer.diagnostics.window_y == pytest.approx(-1.6)


def test_no_tick_compiles_after_warm_up(avoider):
    ImprovedVfh.warm_up()
    kernels = (avoidance.insert_beams, avoidance.survey, avoidance.free_command)
    before = [len(kernel.signatures) for kernel in kernels]
    avoider.avoid(given(sonars([0.5] * 8)))
    avoider.avoid(given(sonars([0.5] * 8), laser(np.full(101, 1.0))))
    avoider.avoid(given())
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert min(before) >= 1


def test_unknown_keys_and_wrong_values_are_refused():
    for wrong in ({"treshold": 0.2}, {"window": 3}, {"enlargement": "circle"}):
        with pytest.raises(ValidationError):
            ImprovedVfhParams(**wrong)
