"""Real logs through localizers: reference poses between scans, made faults, the measure; and a real log where it is."""

from __future__ import annotations

import math
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from navloom.messages import PoseTrack
from navloom.runs.localization import Localization

sys.path.insert(0, str(Path(__file__).parents[1]))
from log_drives import LogDrive, drive, faulty, read
from real_logs import kuemmerle, left_out, report

DATA = Path(os.environ.get("NAVLOOM_DATA", "")) / "carmen"


def straight(seconds: int = 20) -> LogDrive:
    """1 m/s along x, odometry every second."""
    stamps_ns = 1_000_000_000 * np.arange(1, seconds + 2)
    poses = np.column_stack([np.arange(seconds + 1.0), np.zeros(seconds + 1), np.zeros(seconds + 1)])
    return LogDrive(stamps_ns, poses, poses, (), PoseTrack(stamps_ns, poses))


@pytest.mark.parametrize(
    ("fault", "amount", "end"),
    [
        ("turn", 90.0, (6.0, 14.0, math.pi / 2)),  # after 6 m it drives along y
        ("spin", 0.5, (21.0, 0.0, 0.0)),  # two seconds of half a metre
        ("drag", 2.0, (18.0, 0.0, 0.0)),
    ],
)
def test_a_fault_is_a_wrong_step_of_the_odometry(fault: str, amount: float, end: tuple[float, ...]) -> None:
    log = straight()
    same, odometry = faulty(log, fault, int(log.stamps_ns[5]), amount)
    assert same is log and odometry[-1] == pytest.approx(end, abs=1e-9)
    assert odometry[:6].tolist() == log.odometry[:6].tolist()


def test_a_gap_is_time_without_messages() -> None:
    log, odometry = faulty(straight(), "gap", 6_000_000_000, 3.0)
    assert np.diff(log.stamps_ns).max() == 5_000_000_000 and len(odometry) == 17


def test_kuemmerles_measure_is_the_error_of_the_relation(tmp_path: Path) -> None:
    """The log drives 2 m between two poses whose true relation is 1.9 m and 3 degrees."""
    poses = straight().truth
    relations = tmp_path / "relations"
    relations.write_text(f"104 106 1.9 0 0 0 0 {math.radians(3.0)!r}\n900 901 0 0 0 0 0 0\n")
    found = kuemmerle(Localization(np.arange(21.0), poses, poses), 0, relations, 100.0)
    assert (found["relations"], found["translation_m"], found["rotation_deg"]) == (1, [0.1, 0.0], [3.0, 0.0])


def test_odometry_alone_is_always_sure_and_wrong_after_a_turn() -> None:
    log = straight()
    log, odometry = faulty(log, "turn", int(log.stamps_ns[5]), 30.0)
    found, said = drive(log, "odometry", None, odometry=odometry)
    row = report(found, said)
    assert (row["end"], row["not_tracking_s"]) == ("false", 0.0)
    assert row["false_tracking_s"] == 14.0  # from 6 m on, where it is 15 degrees off and more


@pytest.mark.skipif(not DATA.is_dir(), reason="NAVLOOM_DATA has no carmen logs")
def test_a_localizer_keeps_a_real_log_on_the_map_of_its_other_scans() -> None:
    log = read(DATA / "orebro-corrected.log.gz")
    known, rest = left_out(replace(log, scans=log.scans[:60]), "alternate")
    rest = rest.between(0, log.scans[59].stamp_ns)
    assert len(rest.scans) == 30
    found, _ = drive(rest, "scan_matching", known)
    assert np.median(found.error[found.is_tracking]) < 0.15
