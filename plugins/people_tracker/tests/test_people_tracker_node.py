"""The node in whole runs: its tracks beside the bodies of the simulator, with a map and without one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from navloom import Tracks
from navloom.config import load_config
from navloom.runs.episode import Episode, run_episode
from navloom.runs.metrics import measure
from navloom_people_tracker.kalman import moved

ROBOT = """
[robot]
footprint = { length = 0.5, width = 0.5 }
[world]
ref = "crossing_person"
[[sensor]]
name = "laser"
kind = "laser_2d"
beams = 360
field_of_view_deg = 359.0
x = 0.1
[avoider]
plugin = "dwa"
[[node]]
name = "people"
plugin = "people_tracker"
"""
MAPPED = '[mapper]\nplugin = "known_map"\n'
SEEN = '[mapper]\nplugin = "scan_grid"\n'


def drive(folder: Path, text: str, *changes: str) -> Episode:
    path = folder / "robot.toml"
    path.write_text(ROBOT + text, "utf-8")
    return run_episode(load_config(str(path), changes), reads=[("node", "tracks")])


@pytest.mark.parametrize(("mapper", "most"), [(MAPPED, 0.1), (SEEN, 0.6)])
def test_a_person_who_crosses_is_tracked_and_nothing_else(tmp_path: Path, mapper: str, most: float) -> None:
    """Without a map, the person has no track for the 5 s in which it stands."""
    found = measure(drive(tmp_path, mapper).trail)
    assert found["false_tracks"] == 0.0 and float(found["track_ospa"] or 0.0) < most
    assert float(found["track_speed_rms"] or 9.0) < 0.2 and float(found["track_ospa_location"] or 9.0) < 0.05


def test_a_second_laser_changes_neither_the_number_nor_the_place(tmp_path: Path) -> None:
    second = '[[sensor]]\nname = "rear"\nkind = "laser_2d"\nbeams = 180\nheading_deg = 90.0\n'
    trail = drive(tmp_path, MAPPED + second, "run.stop_after=12").trail
    assert {tuple(one.ids.tolist()) for one in trail.tracking.moments if one.time > 2.0} == {(1,)}
    assert measure(trail)["track_ospa_location"] < 0.05


def test_sonars_alone_give_no_tracks(tmp_path: Path) -> None:
    sonars = 'sensor=[{ name = "sonars", kind = "sonar_ring", layout = "p3dx" }]'
    trail = drive(tmp_path, MAPPED, sonars, "run.stop_after=3").trail
    assert len(trail.tracking.moments) > 50 and not any(len(one.ids) for one in trail.tracking.moments)


def test_a_turned_odometry_frame_turns_places_and_velocities() -> None:
    means = np.array([[2.0, 0.0, 1.0, 0.0]])
    found, covariances = moved(means, np.diag([1.0, 2.0, 3.0, 4.0])[None], np.array([1.0, 1.0, np.pi / 2]))
    assert found[0] == pytest.approx([1.0, 3.0, 0.0, 1.0])
    assert np.diag(covariances[0]) == pytest.approx([2.0, 1.0, 4.0, 3.0])


def test_true_tracks_are_the_bodies_of_the_simulator_and_named_by_who_reads_them(tmp_path: Path) -> None:
    truth = '[[sensor]]\nname = "told"\nkind = "true_tracks"\n'
    path = tmp_path / "robot.toml"
    path.write_text(ROBOT + MAPPED + truth, "utf-8")
    chosen = 'avoider.inputs={tracks="platform.told"}'
    episode = run_episode(load_config(str(path), ("run.stop_after=8", chosen)), reads=[("platform", "told")])
    messages = [message for _, message in episode.recorder.streams["platform", "told"] if isinstance(message, Tracks)]
    bodies = episode.trail.bodies
    assert len(messages) > 100 and {tuple(message.ids.tolist()) for message in messages} == {(1,)}
    assert [message.positions[0].tolist() for message in messages] == bodies.places[: len(messages), 0].tolist()
