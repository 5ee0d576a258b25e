"""Sessions, waiting frames, ages, and frames of messages, each by itself."""

from __future__ import annotations

import asyncio
import json
import sys
import zlib
from dataclasses import replace
from importlib.metadata import distribution
from pathlib import Path

import navloom_dashboard
import numpy as np
import pytest
from navloom import (
    MapUpdate,
    Navigator,
    NavloomError,
    OccupancyGrid,
    Pose2D,
    PoseEstimate,
    RangeScan,
    Selection,
    Twist2D,
)
from navloom.messages import Hypotheses, PoseTrack, Sweep, Tracks
from navloom_dashboard.app import Dashboard
from navloom_dashboard.frames import hypotheses_frame, map_frame, scan_frame, sweep_frame
from navloom_dashboard.outbox import Frame, Outbox, text_frame
from navloom_dashboard.recordings import Recordings
from navloom_dashboard.robot_link import RobotLink, Where
from navloom_dashboard.robot_view import AGE_WINDOW, AgeClock, RobotView
from navloom_dashboard.sessions import IDLE_LIMIT, LIFETIME, MOST_SESSIONS, WRONG_WINDOW, Sessions, TooManyLogins
from navloom_live import Told


def opened(sessions: Sessions, now: float) -> str:
    found = sessions.login(sessions.tokens["view"], "10.0.0.1", now)
    assert found is not None
    return found[0]


def test_a_session_ends_when_it_is_idle_and_at_the_latest_after_its_lifetime() -> None:
    sessions = Sessions()
    secret = opened(sessions, 0.0)
    assert sessions.find(secret, IDLE_LIMIT) is not None
    assert sessions.find(secret, 2.0 * IDLE_LIMIT + 1.0) is None
    secret = opened(sessions, 0.0)
    for now in np.arange(0.0, LIFETIME, IDLE_LIMIT / 2.0):
        assert sessions.find(secret, float(now)) is not None
    assert sessions.find(secret, LIFETIME + 1.0) is None


def test_a_session_ends_when_its_certificate_is_revoked() -> None:
    sessions, is_good = Sessions(), [True]
    secret, _ = sessions.begin("operate", 0.0, lambda: is_good[0])
    assert sessions.find(secret, 1.0) is not None
    is_good[0] = False
    assert sessions.find(secret, 2.0) is None


def test_the_longest_idle_session_makes_room_for_one_more() -> None:
    sessions = Sessions()
    secrets = [opened(sessions, float(number)) for number in range(MOST_SESSIONS)]
    sessions.find(secrets[0], 100.0)
    opened(sessions, 101.0)
    assert sessions.find(secrets[0], 102.0) is not None and sessions.find(secrets[1], 102.0) is None


def test_wrong_tokens_of_one_address_lock_out_no_other() -> None:
    sessions = Sessions()
    for _ in range(10):
        assert sessions.login("guess", "10.0.0.1", 0.0) is None
    with pytest.raises(TooManyLogins):
        sessions.login(sessions.tokens["view"], "10.0.0.1", WRONG_WINDOW - 1.0)
    assert sessions.login(sessions.tokens["view"], "10.0.0.2", 1.0) is not None
    assert sessions.login(sessions.tokens["view"], "10.0.0.1", WRONG_WINDOW + 1.0) is not None


def test_tokens_differ_by_right_and_start() -> None:
    tokens = [token for _ in range(2) for token in Sessions().tokens.values()]
    assert len(set(tokens)) == 4 and min(map(len, tokens)) >= 24


def test_a_thousand_frames_of_three_kinds_wait_as_the_newest_of_each() -> None:
    async def waiting() -> list[str]:
        outbox = Outbox()
        for number in range(1000):
            for kind in ("pose", "state", "map"):
                outbox.put(text_frame(kind, {"number": number}, None))
        assert len(outbox) == 3
        return [(await outbox.take()).head for _ in range(3)]

    assert [json.loads(head + "}")["number"] for head in asyncio.run(waiting())] == [999, 999, 999]


def test_the_age_is_the_delay_behind_the_freshest_message() -> None:
    clock = AgeClock()
    for number in range(20):  # 10 Hz, each 0.02 s on the way, one 0.3 s
        clock.hear(number * 100_000_000, 5.0 + 0.1 * number + (0.3 if number == 7 else 0.02))
    assert clock.age(1_900_000_000, 5.0 + 1.92) == pytest.approx(0.0, abs=1e-9)
    assert clock.age(1_900_000_000, 5.0 + 2.92) == pytest.approx(1.0)
    assert clock.age(None, 9.0) is None


def test_the_age_follows_a_simulation_that_is_slower_than_time() -> None:
    clock = AgeClock()
    for number in range(400):  # half as fast as time, for 40 s
        clock.hear(number * 50_000_000, 0.1 * number)
    age = clock.age(399 * 50_000_000, 39.9)
    assert age is not None and age <= AGE_WINDOW


def test_the_age_is_right_after_the_robot_has_restarted() -> None:
    clock = AgeClock()
    clock.hear(100_000_000_000, 1.0)
    clock.hear(0, 50.0)
    assert clock.age(0, 50.5) == pytest.approx(0.5)


def scan(bearings: np.ndarray, origins: np.ndarray) -> RangeScan:
    n = len(bearings)
    ranges = np.full(n, 2.0)
    ranges[0] = 10.0
    return RangeScan(5, origins, bearings, np.zeros(n), np.zeros(n), ranges, 0.1, 10.0)


def test_a_scanner_is_sent_by_its_first_angle_and_step_and_no_echo_as_infinite() -> None:
    frame = scan_frame(scan(np.linspace(-1.0, 1.0, 5), np.tile([0.2, 0.1], (5, 1))), "laser")
    header = json.loads(frame.head + "}")
    assert (header["pose"], header["angle_min"], header["angle_step"]) == ([0.2, 0.1, 0.0], -1.0, 0.5)
    assert frame.raw is not None and np.frombuffer(frame.raw, "<f4").tolist() == [np.inf, 2.0, 2.0, 2.0, 2.0]


def test_sonars_are_sent_beam_by_beam() -> None:
    frame = scan_frame(scan(np.array([0.5, -0.5]), np.array([[0.1, 0.2], [0.1, -0.2]])), "sonars")
    assert json.loads(frame.head + "}")["beams"] == [[0.1, 0.2, 0.5, 0.0], [0.1, -0.2, -0.5, 0.0]]


def test_a_binary_frame_begins_with_the_length_of_its_header_which_has_the_age() -> None:
    grid = OccupancyGrid(np.array([[0, 100], [-1, 50]], np.int8), 0.5, Pose2D(1.0, 2.0, 0.0))
    data = map_frame(MapUpdate(7, grid, np.empty((0, 4)), ()), 3).wire(1.25, 7.5)
    assert isinstance(data, bytes)
    size = int.from_bytes(data[:4], "little")
    header = json.loads(data[4 : 4 + size])
    assert (header["width"], header["height"], header["version"], header["age"], header["sent"]) == (2, 2, 3, 1.25, 7.5)


def sweep(ranges: list[list[float]]) -> Sweep:
    """Frames at 2 s, level, and 3 s, 45° down; beams ahead and to the left; 1 m above the floor."""
    pitches, times, bearings = np.array([0.0, -np.pi / 4]), np.array([0.0, 1.0]), np.array([0.0, np.pi / 2])
    return Sweep(2_000_000_000, 1, np.array(ranges), pitches, times, bearings, "paper", 0.0, 0.0, 1.0, 0.1, 10.0)


def seen_from_above(frame: Frame | None) -> dict[tuple[int, int], int]:
    """Cells with an echo by their middle, cm of the map, and their values."""
    assert frame is not None and frame.raw is not None
    head = json.loads(frame.head + "}")
    cells = np.frombuffer(zlib.decompress(frame.raw), np.int8).reshape(head["height"], head["width"])
    x, y, _ = head["origin"]
    places = np.argwhere(cells >= 0) * head["resolution"] + (y, x)
    return {(round(100 * px), round(100 * py)): int(cells[cells >= 0][i]) for i, (py, px) in enumerate(places.tolist())}


def test_a_sweep_is_seen_from_above_with_heights_each_echo_from_where_the_robot_was() -> None:
    # It has moved by 5 m along x between the two frames, which look 2 m far, and down to the floor.
    track = PoseTrack(np.array([2_000_000_000, 3_000_000_000]), np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]]))
    frame = sweep_frame(sweep([[2.0, 10.0], [2.0**0.5, 10.0]]), track, 2.0)
    assert seen_from_above(frame) == {(200, 0): 50, (600, 0): 0}


def test_a_sweep_shows_nothing_above_the_robot_and_the_highest_of_what_is_below() -> None:
    track = PoseTrack(np.array([0]), np.zeros((1, 3)))
    assert sweep_frame(sweep([[2.0, 3.0], [10.0, 10.0]]), track, 0.9) is None
    both_at_1_m = sweep([[1.0, 10.0], [2.0**0.5, 10.0]])
    assert seen_from_above(sweep_frame(both_at_1_m, track, 1.0)) == {(100, 0): 100}


def test_a_far_echo_makes_the_cells_of_a_sweep_larger_not_more() -> None:
    wide = sweep([[9000.0, 9000.0], [20000.0, 20000.0]])
    frame = sweep_frame(replace(wide, range_max=10000.0), PoseTrack(np.array([0]), np.zeros((1, 3))), 2.0)
    assert frame is not None and frame.raw is not None
    assert len(zlib.decompress(frame.raw)) < 1.01e6


def test_a_view_places_a_sweep_by_the_poses_it_has_heard_of_the_run_that_lasts() -> None:
    view = RobotView({"localizer": "main"}, 2.0)

    def heard(role: str, port: str, stamp_ns: int, message: object) -> list[Frame]:
        return [one for one in view.take([Told(role, "main", port, message, stamp_ns)]) if one.slot == "sweep"]  # type: ignore[arg-type]

    image = sweep([[2.0, 10.0], [10.0, 10.0]])
    assert heard("platform", "laser", 3_000_000_000, image) == []
    for stamp_ns, x in ((9_000_000_000, 50.0), (1_000_000_000, 1.0)):  # the robot has restarted
        pose = PoseEstimate(stamp_ns, Pose2D(x, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
        heard("localizer", "pose", stamp_ns, pose)
    (frame,) = heard("platform", "laser", 3_000_000_000, image)
    assert seen_from_above(frame) == {(300, 0): 50}


def test_places_where_a_robot_may_be_are_sent_if_there_are_several() -> None:
    poses, weights = np.array([[1.0, 2.0, 0.5], [3.0, 4.0, -0.5]]), np.array([0.7, 0.2])
    sent = json.loads(hypotheses_frame(Hypotheses(5, poses, weights)).head + "}")["places"]
    assert [(one["x"], one["heading"], one["weight"]) for one in sent] == [(1.0, 0.5, 0.7), (3.0, -0.5, 0.2)]
    assert json.loads(hypotheses_frame(Hypotheses(5, poses[:1], weights[:1])).head + "}")["places"] == []


def test_tracks_of_a_shadow_are_not_shown() -> None:
    none, two = np.empty((0, 2)), RobotView({"tracker": "a"}, 1.0)
    tracks = Tracks(0, np.empty(0, np.int64), none, none, np.empty((0, 4, 4)), np.empty(0), np.empty(0))
    sent = [[frame.slot for frame in two.take([Told("tracker", name, "tracks", tracks, 0)])] for name in ("a", "b")]
    assert sent == [["tracks tracker tracks"], []]


def test_a_robot_that_was_gone_shows_its_map_again_though_it_is_the_same() -> None:
    async def maps() -> list[bool]:
        link = RobotLink("lab/a", Where("lab/a"), asyncio.get_running_loop())
        grid = OccupancyGrid(np.zeros((2, 2), np.int8), 0.5, Pose2D(0.0, 0.0, 0.0))
        found = []
        for _ in range(2):
            link._encode(MapUpdate(7, grid, np.empty((0, 4)), ()))
            await asyncio.sleep(0)
            found.append("map" in link.latest)
            link._put([text_frame("gone", {}, None)])
        link.close()
        return found

    assert asyncio.run(maps()) == [True, True]


RECORDER = """#!/bin/sh
echo "navloom: recording lab/a to it" >&2
head -c 200000 /dev/zero | tr "\\0" "\\n" >&2
echo "navloom: no space left" >&2
exit 1
"""
"""Says more than a pipe holds, and fails."""


def test_a_recorder_that_says_much_is_not_held_and_its_failure_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "recorder").write_text(RECORDER)
    (tmp_path / "recorder").chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "recorder"))

    async def record() -> tuple[str | None, str]:
        recordings = Recordings(tmp_path)
        await recordings.start("lab/a", Where("lab/a"))
        async with asyncio.timeout(20.0):
            while not recordings.failure("lab/a"):
                await asyncio.sleep(0.01)
        found = recordings.running("lab/a"), recordings.failure("lab/a")
        with pytest.raises(NavloomError, match="ended by itself: no space left"):
            await recordings.stop("lab/a")
        return found

    assert asyncio.run(record()) == (None, "no space left")


def test_another_active_mapper_shows_its_map_of_before_and_another_localizer_no_places_of_the_last() -> None:
    def grid(columns: int) -> MapUpdate:
        cells = OccupancyGrid(np.zeros((2, columns), np.int8), 0.5, Pose2D(0.0, 0.0, 0.0))
        return MapUpdate(0, cells, np.empty((0, 4)), ())

    async def shown() -> tuple[list[int], list[str]]:
        link, widths = RobotLink("lab/a", Where("lab/a"), asyncio.get_running_loop()), []
        link._view = RobotView({"mapper": "a", "localizer": "a"}, 1.0)
        chosen = Selection(1, 0, ("localizer b", "mapper b"))
        places = Hypotheses(0, np.zeros((2, 3)), np.array([0.5, 0.5]))
        for told in (
            [Told("mapper", "b", "map", grid(5), 0), Told("mapper", "a", "map", grid(3), 0)],
            [Told("localizer", "a", "hypotheses", places, 0), Told("gate", "main", "selection", chosen, 1)],
        ):
            link._mapped = -100.0
            link._take(told)
            assert link._encoding is not None
            await asyncio.wrap_future(link._encoding)
            await asyncio.sleep(0)
            widths.append(json.loads(link.latest["map"].head + "}")["width"])
        link.close()
        return widths, json.loads(link.latest["hypotheses"].head + "}")["places"]

    assert asyncio.run(shown()) == ([3, 5], [])


def test_what_it_adds_to_an_installation_is_below_4_mb() -> None:
    added = ["navloom-dashboard", "starlette", "uvicorn", "websockets", "anyio", "h11", "idna"]
    size = 0
    for name in added[1:]:
        files = distribution(name).files or ()
        size += sum(Path(str(file.locate())).stat().st_size for file in files if file.suffix != ".pyc")
    own = Path(navloom_dashboard.__file__).parent
    size += sum(path.stat().st_size for path in own.rglob("*") if path.is_file() and path.suffix != ".pyc")
    assert 1e6 < size < 4e6


def test_robots_of_one_world_are_shown_to_each_other(tmp_path: Path) -> None:
    async def members() -> dict[str, list[str]]:
        dashboard = Dashboard(dict, tmp_path, "cookie", is_secure=False)
        for name, world in (("lab/a", "hall"), ("lab/b", "hall"), ("lab/c", "yard"), ("lab/gone", "hall")):
            link = dashboard.robots[name] = RobotLink(name, Where(name), asyncio.get_running_loop())
            link.world = world
            link._view.pose = PoseEstimate(0, Pose2D(1.0, 2.0, 0.5), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
            link._reader = None if name == "lab/gone" else Navigator(name)
        showing = asyncio.create_task(dashboard._show_members())
        await asyncio.sleep(0)
        showing.cancel()
        shown = {name: link.latest.get("members") for name, link in dashboard.robots.items()}
        for link in dashboard.robots.values():
            link.close()
        return {
            name: [one["name"] for one in json.loads(frame.head + "}")["members"]]
            for name, frame in shown.items()
            if frame is not None
        }

    assert asyncio.run(members()) == {"lab/a": ["lab/b"], "lab/b": ["lab/a"]}
