"""Closed loop in lockstep: a robot with a 2D laser drives through a world without a map of it."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

import numpy as np
from navloom import Discovery
from navloom.config import load_config
from navloom.runs.episode import run_episode

LASER = '{name="laser",kind="laser_2d",beams=181,field_of_view_deg=270.0,range_max=10.0}'


def test_a_door_beside_the_straight_way_is_found_and_passed() -> None:
    loaded = load_config(
        "building",
        ["run.stop_after=60.0", f"sensor=[{LASER}]", 'localizer={plugin="odometry"}', 'mapper={plugin="scan_grid"}'],
    )
    installed = [point for point in entry_points(group="navloom") if point.name != "mapper.scan_grid"]
    found = [*installed, EntryPoint("mapper.scan_grid", "navloom_scan_grid", "navloom")]
    episode = run_episode(loaded, discovery=Discovery(found=found))
    assert episode.summary()["truly_reached"], episode.result.reason
    assert episode.recorder.min_clearance > 0.03
    assert 1.4 < np.interp(3.1, episode.recorder.driven[:, 1], episode.recorder.driven[:, 0]) < 2.6
