"""`navloom calibrate` on recordings: what it prints, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from calibration_drives import recorded
from navloom.cli.main import app
from navloom.messages import Odometry, Pose2D, RangeScan, Twist2D
from navloom_recording import RANGE_SCAN, RecordingError, imported_config, late_note, writing
from typer.testing import CliRunner

RUN = CliRunner()
BEGIN_NS = 1_700_000_000_000_000_000
"""Stamps of a wall clock: as seconds in floating point they would have lost their microseconds."""


def write(path: Path, scans: bool = True, odometry: bool = True, half_angle: float = 0.0) -> Path:
    """A recording of 40 s with scans that are 0.12 s late."""
    beams, way = recorded(40.0, late=0.12)
    events: list[tuple[int, str, Odometry | RangeScan]] = []
    for stamp, (x, y, heading) in zip(way.stamps, way.poses.tolist(), strict=True):
        at = BEGIN_NS + round(1e9 * stamp)
        events += [(at, "odometry", Odometry(at, Pose2D(x, y, heading), Twist2D(0.0, 0.0, 0.0)))] if odometry else []
    for one in beams if scans else ():
        at, halves = BEGIN_NS + round(1e9 * one.stamp), np.full(len(one.ranges), half_angle)
        events.append((at, "laser", RangeScan(at, one.origins, one.bearings, halves, *one[4:])))
    with writing(path, imported_config("drive.log", {"laser": RANGE_SCAN}), "drive.log") as log:
        for at, port, message in sorted(events, key=lambda event: event[0]):
            log.put(port, message, at)
    return path


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("drive") / "drive.mcap")


def test_it_prints_the_lines_for_the_config_and_draws_before_and_after(drive: Path, tmp_path: Path) -> None:
    done = RUN.invoke(app, ["calibrate", str(drive), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0
    assert '[[sensor]]\nname = "laser"\ntime_offset = -0.1' in done.stdout
    assert "its mount is right" in done.stdout
    assert (tmp_path / "out" / "laser.png").read_bytes().startswith(b"\x89PNG")


def test_it_prints_json_with_intervals(drive: Path) -> None:
    done = RUN.invoke(app, ["calibrate", str(drive), "--json"])
    (laser,) = json.loads(done.stdout)["lasers"]
    assert laser["time_offset"]["value"] == pytest.approx(-0.12, abs=0.01)
    assert laser["time_offset"]["low"] < -0.12 < laser["time_offset"]["high"]
    assert laser["mount_yaw_deg"]["low"] < 0.0 < laser["mount_yaw_deg"]["high"]


@pytest.mark.parametrize(
    "given, options, why",
    [
        ({"scans": False}, (), "it holds no scans of a laser"),
        ({"odometry": False}, (), "it holds no odometry"),
        ({"half_angle": 0.2}, (), "it holds no scans of a laser"),  # a sonar's beams
        ({}, ("--sensor", "lazer"), "--sensor lazer: the lasers of"),
    ],
)
def test_what_cannot_be_calibrated_is_refused_in_one_message(
    tmp_path: Path, given: dict[str, float], options: tuple[str, ...], why: str
) -> None:
    path = write(tmp_path / "drive.mcap", **given)  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match=why):
        RUN.invoke(app, ["calibrate", str(path), *options], catch_exceptions=False)


def test_a_file_that_is_no_log_is_refused_by_the_import(tmp_path: Path) -> None:
    (tmp_path / "notes.log").write_text("nothing\n")
    with pytest.raises(RecordingError, match="its options are those of `navloom import`"):
        RUN.invoke(app, ["calibrate", str(tmp_path / "notes.log")], catch_exceptions=False)


def test_the_note_of_an_import_names_the_late_laser_and_the_command(drive: Path) -> None:
    assert late_note(drive) == (
        f"the scans of laser are about 0.12 s late: measure it with `navloom calibrate {drive}`"
    )


def test_the_note_of_an_import_is_empty_where_nothing_can_be_said(tmp_path: Path) -> None:
    assert late_note(write(tmp_path / "drive.mcap", odometry=False)) == ""


def test_a_replay_of_a_log_with_the_offset_draws_thinner_walls(drive: Path) -> None:
    cells = {}
    for offset in (0.0, -0.12):
        change = f"sensor.laser.time_offset={offset}"
        done = RUN.invoke(app, ["replay", str(drive), "--mapper", "scan_grid", "--set", change, "--json"])
        cells[offset] = json.loads(done.stdout)["map"]["occupied"]
    assert cells[-0.12] < 0.8 * cells[0.0]
