"""The plugin: the framework's contract, tracks as messages, and its diagnostics."""

import math

import numpy as np
import pytest
from avoider_scans import FREE, given, laser, make, sonars
from navloom import Discovery, Tracks
from navloom.config import load_config
from navloom.runs import run_episode
from navloom.testing import extras
from navloom_orca import crowd, half_planes, outline, programme
from navloom_orca.adapter import Orca
from navloom_orca.params import OrcaParams
from pydantic import ValidationError


def tracks(*rows, stamp=0.0, sigma=0.0):
    """A message of tracks (x, y, vx, vy), m and m/s, of radius 0.3 m."""
    rows = np.array(rows, dtype=float).reshape(-1, 4)
    n = len(rows)
    spread = np.tile(np.diag([sigma**2, 0.25 * sigma**2, 0.0, 0.0]), (n, 1, 1))
    return Tracks(
        round(stamp * 1e9), np.arange(1, n + 1), rows[:, :2], rows[:, 2:], spread, np.full(n, 0.3), np.zeros(n)
    )


def with_tracks(message, *scans, **more):
    held = given(*scans, **more)
    object.__setattr__(held, "extra", extras(tracks=(Orca.tracks, message)))
    return held


def test_is_found_by_its_entry_point():
    assert Discovery().role("avoider", "orca") is Orca


def test_without_tracks_it_drives_on():
    answer = make(Orca).avoid(with_tracks(None, laser(np.full(101, np.inf))))
    assert answer.status == "clear"
    assert answer.twist.vx > 0.1


def test_a_person_in_the_way_is_steered_around():
    """Who comes from ahead and 0.1 m to the right: to the left, or slower than alone."""
    alone = make(Orca).avoid(with_tracks(None))
    answer = make(Orca).avoid(with_tracks(tracks((2.0, -0.1, -1.0, 0.0))))
    assert answer.status == "steering"
    assert answer.twist.vx < alone.twist.vx - 0.05 or answer.twist.wz > 0.1


@pytest.mark.parametrize("scan", [sonars([math.inf, math.inf, 0.6] + [math.inf] * 5), laser(np.full(101, 1.5))])
def test_lasers_and_sonars_are_seen(scan):
    assert make(Orca).avoid(with_tracks(None, scan)).diagnostics.window.max() == 15


def test_the_diagnostics_show_the_violation_by_direction():
    """A person 1.5 m ahead: ahead is violated more than to the back; the chosen direction is one of the least."""
    shown = make(Orca).avoid(with_tracks(tracks((1.5, 0.0, -1.0, 0.0)), sonars(FREE))).diagnostics
    assert shown.histogram.shape == (72,)
    assert shown.histogram[0] > shown.histogram[36]
    assert "half planes" in shown.why


def test_explore_without_a_tracker_runs():
    episode = run_episode(load_config("explore", ['avoider.plugin="orca"', "run.stop_after=1.0"]))
    assert not episode.log.faults


def test_no_tick_compiles_after_warm_up():
    Orca.warm_up()
    kernels = (
        half_planes.put_agent, programme.best_velocity, crowd.put_lines, outline.lines_of,
    )  # fmt: skip
    before = [len(kernel.signatures) for kernel in kernels]
    plugin = make(Orca)
    for k, scan in enumerate((laser(np.full(101, 0.9)), sonars([0.6] * 8), laser(np.full(101, np.inf)))):
        plugin.avoid(with_tracks(tracks((1.5, 0.2, -1.0, 0.0)), scan, time=0.05 * k))
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert min(before) >= 1


def test_unknown_keys_and_wrong_values_are_refused():
    for wrong in ({"radius": 0.2}, {"share": 0.4}, {"horizon": 0.0}, {"centre": 0.0}):
        with pytest.raises(ValidationError):
            OrcaParams(**wrong)
