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
from navloom_mppi.critics import CRITICS
from navloom_mppi.params import MppiParams
from pydantic import ValidationError


def avoider(**params):
    spec = robot(half_track=0.3, max_angular=1.0)
    return make(Mppi, context(spec, role="avoider"), **{"samples": 200} | params)


def given(*scans, x=0.0, v=0.0, time=0.0, turn_to=None, tracks=None):
    """On a straight trajectory of 5 m along the x axis."""
    estimate = PoseEstimate(0, Pose2D(x, 0.0, 0.0), Twist2D(v, 0.0, 0.0), np.zeros((3, 3)))
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


def test_drawn_roll_outs_are_those_of_the_step():
    """64 of 200, in the map frame: they begin at the robot, the first is the cheapest, and its end is where it led."""
    plugin = avoider()
    plugin.avoid(given(sonars(FREE), x=1.0))
    shown, method = plugin.rollouts(), plugin._method
    assert shown.points.shape == (64, 14, 2)
    assert np.abs(shown.points[:, 0] - (1.0, 0.0)).max() < 0.05
    best = int(method.costs.argmin())
    assert shown.costs[0] == 0.0 and shown.costs[np.isfinite(shown.costs)].max() == 1.0
    x, y = shown.points[0, -1] - (1.0, 0.0)
    # The last point drawn is 4 steps, 0.2 s, before the end, so its bearing is nearly that of the end.
    assert math.atan2(y, x) == pytest.approx(method.ends[best], abs=0.15)


def test_drawn_roll_outs_end_before_a_collision():
    """A plan of 0.5 m/s towards a wall 0.6 m before the front: some collide, none is drawn more than 0.6 m ahead."""
    plugin = avoider()
    plugin._method.plan[:, 0] = 0.5
    front = float(plugin.context.robot.footprint[:, 0].max())
    plugin.avoid(given(laser((front + 0.6) / np.cos(np.radians(np.linspace(-50.0, 50.0, 101)))), v=0.5))
    shown = plugin.rollouts()
    assert np.isinf(shown.costs).any()
    assert 0.4 < shown.points[np.isinf(shown.costs), :, 0].max() < 0.6


def test_the_critics_of_the_drawn_plan_are_its_weighted_costs():
    plugin = avoider()
    plugin.avoid(given(sonars(FREE)))
    method, shown = plugin._method, plugin.rollouts()
    assert dict(zip(shown.critics, shown.critic_costs, strict=True))["path_follow"] == pytest.approx(
        method.by_critic[CRITICS.index("path_follow")] * method.part[CRITICS.index("path_follow")]
    )
    assert shown.chosen == pytest.approx(method.track[::4, :2], abs=1e-6)


def test_the_extra_inputs_are_those_of_the_reference_node():
    assert (Mppi.trajectory.carries, Mppi.reference.carries) == (Trajectory, Reference)


def test_no_tick_compiles_after_warm_up():
    Mppi.warm_up()
    kernels = (
        nearest.fill_nearest, rollout.roll_out, rollout.roll_out_plan, rollout.draw, weighting.weights_of,
        weighting.mean_of, weighting.effective, stays_free, fill_field,
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
