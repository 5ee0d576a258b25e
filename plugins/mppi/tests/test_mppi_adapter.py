"""The plugin: the framework's contract, and its diagnostics."""

import math

import numpy as np
import pytest
from avoider_scans import FREE, laser, sonars
from navloom import AvoiderInput, Discovery, Point2D, Pose2D, PoseEstimate, Reference, Trajectory, Twist2D
from navloom.testing import context, extras, make, robot, trajectory
from navloom_dwa.field import fill_field
from navloom_dwa.rollout import stays_free
from navloom_mppi import nearest, rollout, weighting
from navloom_mppi.adapter import Mppi
from navloom_mppi.params import MppiParams
from pydantic import ValidationError


def avoider(**params):
    spec = robot(half_track=0.3, max_angular=1.0)
    return make(Mppi, context(spec, role="avoider"), **{"samples": 200} | params)


def given(*scans, x=0.0, time=0.0, turn_to=None, tracks=None):
    """On a straight trajectory of 5 m along the x axis."""
    estimate = PoseEstimate(0, Pose2D(x, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
    way, place = np.array([[x, 0.0], [x + 1.0, 0.0]]), Pose2D(x, 0.0, 0.0)
    reference = Reference(1, x, 5.0 - x, place, 0.3, 0.0, 0.0, Point2D(x + 1.0, 0.0), way, 0.5, turn_to)
    held = extras(
        trajectory=(Mppi.trajectory, trajectory()), reference=(Mppi.reference, reference), tracks=(Mppi.tracks, tracks)
    )
    stamp, wanted = round(time * 1e9), Twist2D(0.3, 0.0, 0.0)
    return AvoiderInput(stamp, scans, estimate, Point2D(x + 1.0, 0.0), 0.5, wanted, 4.0 - x, extra=held)


def test_is_found_by_its_entry_point():
    assert Discovery().role("avoider", "mppi") is Mppi


def test_it_reads_the_trajectory_from_the_reference_point_on():
    """Straight ahead and nothing in the way: it drives on. At 4.9 m of 5 it is near the goal."""
    plugin = avoider()
    answer = plugin.avoid(given(x=1.0))
    assert answer.status == "clear"
    assert answer.twist.vx > 0.0
    assert not plugin._method.scene.is_near_goal
    assert plugin._method.scene.goal == pytest.approx((4.0, 0.0), abs=1e-6)
    plugin.avoid(given(x=4.9))
    assert plugin._method.scene.is_near_goal


@pytest.mark.parametrize("scan", [sonars([math.inf, math.inf, 0.6] + [math.inf] * 5), laser(np.full(101, 1.5))])
def test_lasers_and_sonars_are_seen(scan):
    answer = avoider().avoid(given(scan))
    assert answer.diagnostics.window.max() == 15


def test_the_diagnostics_show_directions_of_roll_outs():
    """Nothing in the way: the cheapest direction has cost 0, and is ahead; a roll-out to the back costs more."""
    plugin = avoider()
    for k in range(10):
        shown = plugin.avoid(given(sonars(FREE), time=0.05 * k)).diagnostics
    assert shown.histogram.shape == (72,)
    assert shown.histogram.argmin() in (0, 1, 2, 3, 68, 69, 70, 71)
    assert abs(shown.chosen) < 0.5
    assert "200 roll-outs" in shown.why


def test_the_extra_inputs_are_those_of_the_reference_node():
    assert (Mppi.trajectory.carries, Mppi.reference.carries) == (Trajectory, Reference)


def test_no_tick_compiles_after_warm_up():
    Mppi.warm_up()
    kernels = (
        nearest.fill_nearest, rollout.roll_out, rollout.roll_out_plan, weighting.weights_of, weighting.mean_of,
        weighting.effective, stays_free, fill_field,
    )  # fmt: skip
    before = [len(kernel.signatures) for kernel in kernels]
    for plugin in (avoider(), avoider(turning_radius=1.0)):
        plugin.avoid(given())
        plugin.avoid(given(laser(np.full(101, 0.5)), sonars([0.5] * 8), time=0.05))
        plugin.avoid(given(sonars(FREE), time=0.1, turn_to=1.0))
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert min(before) >= 1


def test_unknown_keys_and_wrong_values_are_refused():
    for wrong in ({"lambda": 0.2}, {"samples": 1}, {"temperature": 0.0}, {"soft": 0.0}):
        with pytest.raises(ValidationError):
            MppiParams(**wrong)
