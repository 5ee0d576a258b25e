"""A live robot keeps its last good pose, and begins there as a guess."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.starts import starts_of
from navloom.messages import OccupancyGrid, Pose2D, PoseEstimate, Twist2D
from navloom_live.hosting import kept_pose
from navloom_live.hosting.kept_pose import Kept, KeptPose, starting_at, state_folder

MAP = OccupancyGrid(np.zeros((4, 5), dtype=np.int8), 0.1, Pose2D(0.0, 0.0, 0.0))


def estimate(x: float, state: str = "tracking", covariance: float = 0.0) -> PoseEstimate:
    still, reason = Twist2D(0.0, 0.0, 0.0), "" if state == "tracking" else "several places fit"
    return PoseEstimate(0, Pose2D(x, 2.0, 0.5), still, covariance * np.eye(3), state, reason)  # type: ignore[arg-type]


@pytest.fixture
def times(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time of the process, s, which a test sets."""
    now = [100.0]
    monkeypatch.setattr(kept_pose.time, "monotonic", lambda: now[0])
    return now


def test_a_good_pose_comes_back_as_a_guess(tmp_path: Path) -> None:
    KeptPose(tmp_path / "new", "lab", "r1", MAP).note(estimate(1.0))
    kept = KeptPose(tmp_path / "new", "lab", "r1", MAP).read()
    assert kept is not None and (kept.x, kept.y, kept.heading) == (1.0, 2.0, 0.5)
    assert (kept.spread, kept.heading_spread) == (0.5, math.radians(15.0))


def test_an_unsure_pose_is_kept_with_its_own_spread(tmp_path: Path) -> None:
    KeptPose(tmp_path, "lab", "r1", MAP).note(estimate(1.0, covariance=4.0))
    kept = KeptPose(tmp_path, "lab", "r1", MAP).read()
    assert kept is not None and (kept.spread, kept.heading_spread) == (2.0, 2.0)


def test_a_robot_that_does_not_know_where_it_is_keeps_where_it_was(tmp_path: Path, times: list[float]) -> None:
    keeper = KeptPose(tmp_path, "lab", "r1", MAP)
    keeper.note(estimate(1.0))
    times[0] += 10.0
    keeper.note(estimate(5.0, "searching"))
    keeper.write()
    kept = keeper.read()
    assert kept is not None and kept.x == 1.0


def test_it_is_written_every_two_seconds_at_most_and_at_the_end(tmp_path: Path, times: list[float]) -> None:
    keeper = KeptPose(tmp_path, "lab", "r1", MAP)
    seen = []
    for x in (1.0, 1.5, 2.0, 2.5, 3.0):
        keeper.note(estimate(x))
        seen.append(keeper.read().x)  # type: ignore[union-attr]
        times[0] += 1.0
    assert seen == [1.0, 1.0, 2.0, 2.0, 3.0]
    keeper.note(estimate(3.5))
    keeper.write()
    assert keeper.read().x == 3.5  # type: ignore[union-attr]


def test_a_robot_that_stands_writes_nothing(tmp_path: Path, times: list[float]) -> None:
    keeper = KeptPose(tmp_path, "lab", "r1", MAP)
    keeper.note(estimate(1.0))
    keeper.path.unlink()
    times[0] += 10.0
    keeper.note(estimate(1.01))
    assert not keeper.path.exists()


def test_a_pose_of_another_map_or_robot_says_nothing(tmp_path: Path) -> None:
    KeptPose(tmp_path, "lab", "r1", MAP).note(estimate(1.0))
    cells = MAP.cells.copy()
    cells[0, 0] = 100
    assert KeptPose(tmp_path, "lab", "r1", replace(MAP, cells=cells)).read() is None
    assert KeptPose(tmp_path, "lab", "r1", replace(MAP, origin=Pose2D(1.0, 0.0, 0.0))).read() is None
    assert KeptPose(tmp_path, "lab", "r2", MAP).read() is None


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"x": 1}', "\0", '{"x": "a"}'])
def test_a_damaged_file_says_nothing(text: str, tmp_path: Path) -> None:
    keeper = KeptPose(tmp_path, "lab", "r1", MAP)
    keeper.path.write_text(text, "utf-8")
    assert keeper.read() is None


def test_a_number_that_is_not_finite_says_nothing(tmp_path: Path) -> None:
    keeper = KeptPose(tmp_path, "lab", "r1", MAP)
    keeper.note(estimate(1.0))
    keeper.path.write_text(json.dumps({**json.loads(keeper.path.read_text("utf-8")), "x": math.nan}), "utf-8")
    assert keeper.read() is None


def test_a_folder_that_cannot_be_written_is_told_once(tmp_path: Path, times: list[float]) -> None:
    said: list[str] = []
    (tmp_path / "file").touch()
    keeper = KeptPose(tmp_path / "file", "lab", "r1", MAP, said.append)
    for x in (1.0, 2.0):
        keeper.note(estimate(x))
        times[0] += 10.0
    (told,) = said
    assert "cannot be kept" in told and "set NAVLOOM_STATE_DIR" in told


def test_the_config_starts_there_and_says_where_that_is_from() -> None:
    loaded = load_config("building", ["navigation.start={x=9,y=9}"])
    begun = starting_at(loaded, Kept(1.0, 2.0, math.pi / 2, 0.5, 0.25, 0.0, ""), Pose2D(9.0, 9.0, 0.0))
    start = begun.config.navigation.start
    assert start is not None and start != "unknown" and (start.x, start.y, start.heading_deg) == (1.0, 2.0, 90.0)
    assert start.sigma == (0.5, pytest.approx(0.25))
    assert {by for place, by in begun.sources.items() if place.startswith("navigation.start")} == {"kept pose"}


def test_a_simulated_robot_still_stands_where_its_config_says() -> None:
    loaded = load_config("building", ["navigation.start={x=1,y=1}", "world.start_offset={x=0.5}"])
    before, kept = assemble(loaded), Kept(0.0, 2.0, math.pi / 2, 0.5, 0.25, 0.0, "")
    begun = starting_at(loaded, kept, before.true_start).config
    assert starts_of(begun, before.world)[2] == before.true_start == Pose2D(1.5, 1.0, 0.0)


def test_the_folder_outlives_a_boot() -> None:
    assert state_folder({"NAVLOOM_STATE_DIR": "/a"}) == Path("/a")
    assert state_folder({"XDG_STATE_HOME": "/b"}) == Path("/b/navloom")
    assert state_folder({}) == Path.home() / ".local" / "state" / "navloom"
