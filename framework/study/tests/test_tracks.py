"""Files of tracks: small, with reproducible bytes, and enough to draw the track."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import numpy as np
import pytest
from navloom.runs.episode_trail import lost_trail
from navloom.runs.shadow_comparison import Disagreement
from navloom_study import Trail
from navloom_study.episode_key import EpisodeKey
from navloom_study.tracks import FOLDER, SAMPLES, encoded, file_of, read_track


def circle(ticks: int) -> Trail:
    """A track once round a circle of 2 m in 20 s; the avoider drives in the second half."""
    time = np.linspace(0.0, 20.0, ticks)
    flat = np.zeros(ticks)
    angle = 0.1 * math.pi * time
    return Trail(
        time=time, x=2.0 * np.cos(angle), y=2.0 * np.sin(angle), heading=angle, vx=flat, wz=flat, clearance=flat,
        cross_track=flat, command_vx=flat, command_wz=flat, engaged=time >= 10.0, stopped_by_gate=time < 0.0,
        outcome="succeeded", reason="", touches=0, recoveries=0, gate_stops=0, period=0.05, optimal=None,
        goal_distance=None, limit=60.0, max_linear=0.5, max_deceleration=1.0, reaction=0.1,
        tick_ns=np.arange(ticks),
    )  # fmt: skip


def kept(folder: Path, content: bytes, key: EpisodeKey) -> None:
    (folder / FOLDER).mkdir(exist_ok=True)
    (folder / FOLDER / file_of(key)).write_bytes(content)


def test_a_track_is_stored_to_the_millimetre(tmp_path: Path) -> None:
    trail, key = circle(401), EpisodeKey("vff", "clutter:0", 3)
    kept(tmp_path, encoded(trail, (1.0, -2.5), 0.2), key)
    track = read_track(tmp_path, key)
    assert track is not None and track.goal is not None
    assert len(track.time) <= SAMPLES + 1 and track.time[0] == 0.0 and track.time[-1] == pytest.approx(20.0)
    assert np.abs(np.hypot(*track.points.T) - 2.0).max() < 1e-3
    assert track.points[-1] == pytest.approx([2.0, 0.0], abs=1e-3)
    assert track.engaged.tolist() == (track.time >= 10.0).tolist()
    assert (track.goal.tolist(), track.tolerance) == ([1.0, -2.5], 0.2)


def test_the_same_track_gives_the_same_bytes_and_a_long_one_stays_small() -> None:
    assert encoded(circle(2401), None, 0.0) == encoded(circle(2401), None, 0.0)
    # 5000 of these take 20 MB at most.
    assert len(encoded(circle(24_001), None, 0.0)) < 4_000


def test_disagreements_of_shadows_are_stored_if_there_are_any(tmp_path: Path) -> None:
    one = Disagreement("avoider", "vff")
    for tick in range(4):
        one.add(tick, 0.05 * tick, "improved_vfh", {"vx": 0.0, "wz": -0.25 * tick})
    key = EpisodeKey("(open loop)", "empty", 0)
    kept(tmp_path, encoded(circle(5), None, 0.0, [one]), key)
    track = read_track(tmp_path, key)
    assert track is not None and list(track.shadow) == ["vff wz"]
    assert track.shadow["vff wz"].tolist() == [0.0, -0.25, -0.5, -0.75]
    assert track.shadow_time["vff wz"] == pytest.approx([0.0, 0.05, 0.1, 0.15])


def test_an_episode_that_never_began_has_no_file() -> None:
    nothing = lost_trail("error", "", period=0.1, limit=1.0, max_linear=1.0, max_deceleration=1.0, reaction=0.1)
    assert encoded(nothing, (0.0, 0.0), 0.2) == b""


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"text"], ids=["empty", "cut", "text"])
def test_a_damaged_file_gives_no_track(tmp_path: Path, content: bytes) -> None:
    key = EpisodeKey("vff", "empty", 0)
    kept(tmp_path, content, key)
    assert read_track(tmp_path, key) is None


def test_a_file_with_other_arrays_gives_no_track(tmp_path: Path) -> None:
    key = EpisodeKey("vff", "empty", 0)
    kept(tmp_path, b"", key)
    with zipfile.ZipFile(tmp_path / FOLDER / file_of(key), "w") as archive:
        archive.writestr("else.txt", "text")
    assert read_track(tmp_path, key) is None


def test_files_are_named_after_their_episode_and_never_leave_the_folder() -> None:
    assert file_of(EpisodeKey("improved_vfh", "u_trap", 3)) == "improved_vfh,u_trap,3.npz"
    odd = [file_of(EpisodeKey("m", world, 0)) for world in ("barn:a/b.npz#1", "barn:a_b.npz#1", "../../x", "w" * 300)]
    assert len(set(odd)) == len(odd)
    assert all("/" not in name and not name.startswith(".") and len(name) < 200 for name in odd)
