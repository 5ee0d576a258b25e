"""Published logs of CARMEN: a map from the corrected poses, and a localizer on the raw odometry in that map."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from navloom import Odometry, RangeScan
from navloom.geometry.echoes import scan_points
from navloom.geometry.frames import transform
from navloom_carmen.carmen_import import import_carmen
from navloom_recording.reader import Recording
from PIL import Image
from scipy.ndimage import binary_dilation

Command = Callable[..., tuple[int, str, str]]
INTEL = ("intel.gfs.log.gz", (-20.0, -35.0), 680, 0.153)
FREIBURG = ("freiburg-101-corrected.log.gz", (-45.0, -10.0), 1043, 0.097)


@pytest.mark.parametrize("log, corner, free, error", [FREIBURG, pytest.param(*INTEL, marks=pytest.mark.slow)])
def test_a_published_log_becomes_a_map_and_feeds_a_localizer(
    data: Path,
    tmp_path: Path,
    in_process: Command,
    log: str,
    corner: tuple[float, float],
    free: float,
    error: float,
) -> None:
    corrected, raw, out, tried = (tmp_path / name for name in ("corrected.mcap", "raw.mcap", "map", "poses"))
    import_carmen(data / "carmen" / log, corrected, poses="corrected")
    import_carmen(data / "carmen" / log, raw)
    odometry, scans = messages(corrected)

    mapper = ("--mapper", "scan_grid", "--set", "mapper.cell=0.1")
    code, said, _ = in_process("replay", str(corrected), *mapper, "--out", str(out), "--json")
    assert code == 0 and json.loads(said)["map"]["free"] * 0.01 == pytest.approx(free, rel=0.02)  # m²
    assert (out / "map.png").stat().st_size > 10_000
    walls = binary_dilation(np.asarray(Image.open(out / "map.pgm"))[::-1] == 0)
    poses = np.array([(one.pose.x, one.pose.y, one.pose.heading) for one in odometry])
    points = np.vstack([transform(pose, scan_points(scan)) for pose, scan in zip(poses, scans, strict=True)])
    columns, rows = ((points - corner) / 0.1).astype(int).T
    mapped = (rows >= 0) & (rows < walls.shape[0]) & (columns >= 0) & (columns < walls.shape[1])
    assert walls[rows[mapped], columns[mapped]].mean() > 0.8  # of the echoes, within 0.1 m of a wall

    localizer = ("--localizer", "scan_matching", "--map", str(out / "map.yaml"))
    code, said, _ = in_process("replay", str(raw), *localizer, "--out", str(tried), "--json")
    assert code == 0 and json.loads(said)["localizer"]["position"]["max"] > 40.0  # how far raw odometry goes astray
    found = np.loadtxt(tried / "poses.csv", delimiter=",", skiprows=1, usecols=range(7))
    stamps = np.array([one.stamp_ns for one in odometry]) * 1e-9 - messages(raw)[0][0].stamp_ns * 1e-9
    nearest = np.searchsorted(found[:, 0], stamps).clip(max=len(found) - 1)
    near = np.abs(found[nearest, 0] - stamps) < 0.3
    away = np.hypot(*(found[nearest, 4:6] - poses[:, :2])[near].T)
    assert near.mean() > 0.85 and np.sqrt((away**2).mean()) == pytest.approx(error, abs=0.02)
    assert (tried / "poses.png").stat().st_size > 10_000


def messages(recording: Path) -> tuple[list[Odometry], list[RangeScan]]:
    with Recording(recording) as opened:
        every = [message.message for message in opened.messages()]
    return [one for one in every if isinstance(one, Odometry)], [one for one in every if isinstance(one, RangeScan)]
