"""CARMEN logs as recordings: raw odometry from corrected poses, stamps, mounts, limits, and refusals."""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom.geometry.frames import compose, inverse
from navloom.messages import Odometry, RangeScan
from navloom_carmen import carmen
from navloom_carmen.carmen_import import import_carmen
from navloom_recording.reader import Recording
from navloom_recording.recording_header import RecordingError

Command = Callable[..., tuple[int, str, str]]


def odom(pose: Any, time: float, speed: str = "0 0") -> str:
    x, y, heading = pose
    return f"ODOM {x:.9g} {y:.9g} {heading:.9g} {speed} 0 {time:.9g} host {time:.9g}"


def laser(laser_pose: Any, robot_pose: Any, time: float, ranges: str = "1 2 3 4", word: str = "FLASER") -> str:
    poses = " ".join(f"{value:.9g}" for value in (*laser_pose, *robot_pose))
    return f"{word} {len(ranges.split())} {ranges} {poses} {time:.9g} host {time:.9g}"


def written(folder: Path, lines: list[str], packed: bool = False) -> Path:
    text = ("\n".join(lines) + "\n").encode()
    path = folder / ("a.log.gz" if packed else "a.log")
    path.write_bytes(gzip.compress(text) if packed else text)
    return path


def imported(folder: Path, lines: list[str], **options: Any) -> tuple[list[Odometry], list[RangeScan]]:
    out = folder / "a.mcap"
    out.unlink(missing_ok=True)
    import_carmen(written(folder, lines), out, **options)
    with Recording(out) as recording:
        messages = [message.message for message in recording.messages()]
    return [m for m in messages if isinstance(m, Odometry)], [m for m in messages if isinstance(m, RangeScan)]


def corrected_log(seed: int) -> tuple[list[str], np.ndarray[Any, Any]]:
    """A log as of a particle filter, which moves by the odometry and jumps at each scan, and the raw poses."""
    random = np.random.default_rng(seed)
    raw = corrected = np.array([0.3, -0.2, 0.5])
    lines, poses = ["# CARMEN Logfile"], []
    for number in range(60):
        step = np.array([0.1, 0.0, random.uniform(-0.3, 0.3)])
        raw, corrected = compose(raw, step), compose(corrected, step)
        poses.append(raw)
        lines.append(odom(corrected, 1.0 + 0.1 * number))
        if number % 5 == 4:
            corrected = corrected + random.normal(0.0, 0.1, 3)
            lines.append(laser(corrected, corrected, 1.0 + 0.1 * number))
            lines += [odom(corrected, 0.0), "NEFF 12.5"]
    return lines, np.array(poses)


@pytest.mark.parametrize("seed", range(3))
def test_raw_odometry_is_recovered_from_a_corrected_log(tmp_path: Path, seed: int) -> None:
    lines, raw = corrected_log(seed)
    odometry, scans = imported(tmp_path, lines)
    found = np.array([(one.pose.x, one.pose.y, one.pose.heading) for one in odometry])
    assert len(scans) == 12 and len(found) == 60
    # The first pose is that of the log; from there on, every step is that of the wheels.
    steps, expected = compose(inverse(found[:-1]), found[1:]), compose(inverse(raw[:-1]), raw[1:])
    assert np.abs(steps - expected).max() < 1e-6
    assert [scan.stamp_ns for scan in scans] == [round((1.0 + 0.1 * n) * 1e9) for n in range(4, 60, 5)]
    assert odometry[30].twist.vx == pytest.approx(1.0, abs=0.05)


def test_the_poses_of_a_corrected_log_are_used_as_odometry_on_request(tmp_path: Path) -> None:
    lines, _ = corrected_log(0)
    odometry, scans = imported(tmp_path, lines, poses="corrected")
    said = [line.split()[6:9] for line in lines if line.startswith("FLASER")]
    assert [one.stamp_ns for one in odometry] == [scan.stamp_ns for scan in scans]
    assert odometry[7].pose.x == pytest.approx(float(said[7][0]))


def test_a_raw_log_keeps_its_poses_and_the_laser_is_mounted_where_its_poses_say(tmp_path: Path) -> None:
    mount = np.array([0.2, 0.0, math.pi / 4])
    lines = []
    for number in range(10):
        pose = np.array([0.1 * number, 1.0, 0.3])
        lines += [odom(pose, 50.0 + number, "0.1 0.02"), laser(compose(pose, mount), pose, 50.5 + number)]
    odometry, scans = imported(tmp_path, lines)
    assert [one.pose.x for one in odometry[:4]] == pytest.approx([0.0, 0.0, 0.1, 0.1])
    assert (odometry[3].twist.vx, odometry[3].twist.wz) == (0.1, 0.02)
    assert scans[0].origins[0].tolist() == pytest.approx([0.2, 0.0], abs=1e-6)
    assert np.degrees(scans[0].bearings).tolist() == pytest.approx([-45.0, 15.0, 75.0, 135.0])


def test_beams_and_limits_of_the_formats(tmp_path: Path) -> None:
    sick = " ".join(["1.0"] * 178 + ["0.0", "81.83"])
    newer = "ROBOTLASER1 0 -0.5 1.0 0.5 30 0.01 0 3 1 29 31 2 7 8 0 0 0 0 0 0 0 0 0 0 0 2.5 host 0.1"
    (scan,) = imported(tmp_path, [odom((0, 0, 0), 0.5), laser((0, 0, 0), (0, 0, 0), 1, sick)])[1]
    # CARMEN: 180 readings begin at -90°, one a degree. 0 is no measurement, and 81.83 m is no echo.
    assert len(scan.ranges) == 179 and math.isinf(scan.ranges[-1]) and scan.range_max == 80.0
    assert np.degrees(scan.bearings[[0, -1]]).tolist() == pytest.approx([-90.0, 89.0])
    (scan,) = imported(tmp_path, [odom((0, 0, 0), 1), newer])[1]
    assert scan.bearings.tolist() == pytest.approx([-0.5, 0.0, 0.5]) and scan.ranges.tolist() == [1.0, 29.0, math.inf]
    (scan,) = imported(tmp_path, [odom((0, 0, 0), 1), newer], range_max=20.0)[1]
    assert scan.ranges.tolist() == [1.0, math.inf, math.inf]
    parameters = ["PARAM robot_front_laser_max 3.5 nohost 0", "PARAM robot_frontlaser_offset -0.04 nohost 0"]
    (scan,) = imported(tmp_path, [*parameters, laser((1, 1, 0), (1, 1, 0), 1)])[1]
    assert math.isinf(scan.ranges[3]) and scan.origins[0].tolist() == [-0.04, 0.0]


def test_times_that_run_back_a_little_are_put_between_the_scans_and_others_are_refused(tmp_path: Path) -> None:
    zero = (0.0, 0.0, 0.0)
    lines = [odom((0, 0, 0), 10.0), odom((1, 0, 0), 11.4), laser(zero, (1, 0, 0), 11.0), odom((2, 0, 0), 10.5)]
    odometry, scans = imported(tmp_path, [*lines, laser(zero, (2, 0, 0), 12.0)])
    assert [scan.stamp_ns * 1e-9 for scan in scans] == [11.0, 12.0]
    assert [(one.stamp_ns * 1e-9, one.pose.x) for one in odometry] == [(10.0, 0.0), (11.0, 2.0), (12.0, 2.0)]
    back = [*lines, laser(zero, (2, 0, 0), 2.0)]
    with pytest.raises(RecordingError, match=r"a\.log: its times are no clock's: line 5 has 2 s.* --period 0\.2"):
        imported(tmp_path, back)
    _, scans = imported(tmp_path, back, period=0.5)
    assert [scan.stamp_ns for scan in scans] == [500_000_000, 1_000_000_000]


def test_damaged_lines_are_left_out_and_counted(tmp_path: Path) -> None:
    lines = [odom((0, 0, 0), 1), "ODOM 1 2", "FLASER 9 1 2 3", "FLASER x", "ODOM nan 0 0 0 0 0 1 h 1", "FLASER 3 1 2 3"]
    found = import_carmen(written(tmp_path, [*lines, laser((0, 0, 0), (0, 0, 0), 2)], packed=True), tmp_path / "o.mcap")
    assert found.scans == {"laser": 1} and found.odometry == 2 and sum(found.skipped.values()) == 5
    assert found.skipped["ODOM: 2 words, expected 10"] == 0 and found.skipped["ODOM: 3 words, expected 10"] == 1
    assert found.skipped["FLASER: no number of readings"] == 1


@pytest.mark.parametrize(
    "lines, why",
    [
        (["hello"], "not a log of CARMEN"),
        ([odom((0, 0, 0), 1)], "no scans: expected lines of FLASER"),
        ([laser((0, 0, 0), (0, 0, 0), 1), "NEFF 3"], "take these, with --poses corrected"),
        ([laser((0, 0, 0), (0, 0, 0), 1), odom((0, 0, 0), 1), "NEFF 3"], "take these, with --poses corrected"),
        ([laser((0, 0, 0), (0, 0, 0), 1, "0 0")], "no scan can be used: FLASER: no reading is a measurement"),
        (["FLASER " + "1 " * 600_000], "line 1: more than 1048576 bytes"),
    ],
)
def test_a_log_that_cannot_be_imported_is_refused_with_the_reason(tmp_path: Path, lines: list[str], why: str) -> None:
    with pytest.raises(RecordingError, match=why):
        imported(tmp_path, lines)
    assert not (tmp_path / "a.mcap").exists()


def test_a_log_is_bounded_before_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = written(tmp_path, ["PARAM a 0 h 0"] * 100_000, packed=True)
    assert log.stat().st_size < 10_000
    monkeypatch.setenv("NAVLOOM_MAX_INPUT_MB", "1")
    with pytest.raises(RecordingError, match="unpacks to more than 1 MB"):
        import_carmen(log, tmp_path / "o.mcap")
    log.write_bytes(log.read_bytes()[:200])
    with pytest.raises(RecordingError, match="damaged gzip"):
        import_carmen(log, tmp_path / "o.mcap")
    monkeypatch.setattr(carmen, "MOST", 5)
    with pytest.raises(RecordingError, match="more than 5 lines of odometry and scans"):
        imported(tmp_path, [odom((0, 0, 0), number) for number in range(9)])


def test_the_command_imports_a_log_and_names_the_distribution_for_bags(tmp_path: Path, in_process: Command) -> None:
    lines, _ = corrected_log(1)
    log, out, world = written(tmp_path, lines), tmp_path / "o.mcap", tmp_path / "room.toml"
    world.write_text("bounds = [-5.0, -5.0, 9.0, 9.0]\n")
    place = ("--map", str(world), "--start", "1,2,90")
    code, said, errors = in_process("import", str(log), "--out", str(out), *place, "--json")
    assert (code, errors) == (0, "") and json.loads(said)["scans"] == {"laser": 12}
    with Recording(out) as recording:
        config = recording.header.loaded().config
        assert config.map is not None and config.map.ref == str(world)
        assert recording.attachment(f"map/{world.name}") == world.read_bytes()
    code, _, errors = in_process("import", str(log), "--out", str(tmp_path / "b.mcap"), "--map", "nowhere")
    assert code == 2 and errors.startswith("navloom: --map nowhere: ")
    code, _, errors = in_process("import", "drive.bag", "--out", str(out))
    assert code == 2 and "use navloom ros import drive.bag" in errors


def turning_log(turn: float) -> list[str]:
    """A corrected log that begins with a scan; the robot turns before the first odometry, and then drives straight."""
    start, place = np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, turn])
    lines = [laser(start, start, 1.0), odom(place, 1.5), "NEFF 12.5"]
    for number in range(20):
        place = compose(place, np.array([0.1, 0.0, 0.0]))
        lines.append(odom(place, 2.0 + 0.1 * number))
        if number % 5 == 4:
            lines += [laser(place, place, 2.0 + 0.1 * number), odom(place, 0.0)]
    return lines


def test_a_turn_between_the_first_scan_and_the_first_odometry_is_a_step_of_the_odometry(tmp_path: Path) -> None:
    odometry, scans = imported(tmp_path, turning_log(math.radians(80.0)))
    assert (odometry[0].stamp_ns, odometry[0].pose.heading) == (scans[0].stamp_ns, 0.0)
    assert math.degrees(odometry[1].pose.heading) == pytest.approx(80.0) and len(odometry) == 22


def test_the_filters_step_stands_for_odometry_that_a_scan_lacks(tmp_path: Path) -> None:
    lines = turning_log(0.0)
    for number in range(20):
        before, place = (2.0 + 0.1 * number, 0.0, 0.0), (2.1 + 0.1 * number, 0.0, 0.0)
        lines += [
            odom(before, 4.9 + number),
            odom(place, 5.0 + number),
            laser(place, place, 5.1 + number),
            odom(place, 0),
        ]
    odometry, _ = imported(tmp_path, [*lines, laser((4.0, 0.7, 0), (4.0, 0.7, 0), 40.0)])
    last = odometry[-1]
    assert (last.pose.x, last.pose.y, last.stamp_ns) == (pytest.approx(4.0), pytest.approx(0.7), 40 * 10**9)


def test_times_with_six_digits_are_those_of_no_clock(tmp_path: Path) -> None:
    zero = (0.0, 0.0, 0.0)
    lines = []
    for number in range(30):
        time = float(f"{976052857.0 + number:.6g}")
        lines += [odom((0.1 * number, 0, 0), time), laser(zero, (0.1 * number, 0, 0), time)]
    with pytest.raises(
        RecordingError,
        match=r"scans: its 30 messages all have the stamp 9\.76053e\+08; odometry: its 30 .*; number the scans",
    ):
        imported(tmp_path, lines)
    assert len(imported(tmp_path, lines, period=0.2)[1]) == 30


def test_a_step_of_the_odometry_that_no_robot_drives_is_named(tmp_path: Path, in_process: Command) -> None:
    zero = (0.0, 0.0, 0.0)
    lines = [odom((0.1 * n + (2.0 if n > 5 else 0.0), 0, 0), 1.0 + 0.1 * n) for n in range(12)]
    log = written(tmp_path, [*lines, laser(zero, (3.1, 0, 0), 2.15)])
    _, said, _ = in_process("import", str(log), "--out", str(tmp_path / "b.mcap"))
    assert "odometry: 1 step is beyond a robot's reach; the largest is 2.10 m and 0° in 0.10 s, at 0.6 s" in said


def test_a_log_can_be_imported_without_its_odometry(tmp_path: Path) -> None:
    odometry, scans = imported(tmp_path, turning_log(0.5), poses="none")
    assert [one.stamp_ns for one in odometry] == [scan.stamp_ns for scan in scans]
    assert {(one.pose.x, one.pose.y, one.pose.heading) for one in odometry} == {(0.0, 0.0, 0.0)}


@pytest.mark.parametrize(
    ("option", "heading", "why"),
    [
        ("--start", "900", "--start 0,0,900: its heading: got 900, expected degrees of -360 to 360"),
        ("--start", "-361", "its heading: got -361, expected degrees of -360 to 360"),
        ("--start", "nan", "expected X,Y,HEADING_DEG in m and degrees"),
        ("--mount", "900", "--mount laser=0,0,900: its yaw: got 900, expected degrees of -360 to 360"),
    ],
)
def test_a_heading_beyond_a_turn_is_refused(
    tmp_path: Path, in_process: Command, option: str, heading: str, why: str
) -> None:
    name = "" if option == "--start" else "laser="
    log, out = written(tmp_path, turning_log(0.0)), tmp_path / "o.mcap"
    code, _, errors = in_process("import", str(log), "--out", str(out), option, f"{name}0,0,{heading}")
    assert code == 2 and why in errors and not out.exists()


@pytest.mark.parametrize(("heading", "degrees"), [("1.5708", 90), ("-3.14", -180), ("1.5", 0), ("90", 0), ("45", 0)])
def test_a_heading_that_looks_like_radians_is_warned_of(
    tmp_path: Path, in_process: Command, heading: str, degrees: int
) -> None:
    log, out = written(tmp_path, turning_log(0.0)), tmp_path / "o.mcap"
    code, _, errors = in_process("import", str(log), "--out", str(out), "--start", f"0,0,{heading}")
    warning = f"a heading of {heading} is read in degrees; if it is in radians, give {degrees}"
    assert code == 0 and (warning in errors) == bool(degrees)


def test_a_start_of_a_whole_turn_is_wrapped(tmp_path: Path, in_process: Command) -> None:
    start = (0.0, 0.0, -3.0)
    log, out = written(tmp_path, [odom(start, 1.0), laser(start, start, 2.0)]), tmp_path / "o.mcap"
    assert in_process("import", str(log), "--out", str(out), "--start", "0,0,360")[0] == 0
    with Recording(out) as recording:
        placed = recording.header.loaded().config.navigation.start
    assert placed is not None and placed.heading_deg == pytest.approx(math.degrees(3.0))  # 360° less -3 rad


def room_scan(x: float) -> str:
    """Ranges of 180 beams at (x, 0) in a room of 8 by 4 m around the origin."""
    bearings = np.radians(np.arange(-90.0, 90.0))
    cosine, sine = np.cos(bearings), np.sin(bearings)
    to_side = 2.0 / np.maximum(np.abs(sine), 1e-9)
    ranges = np.minimum((4.0 - x) / np.maximum(cosine, 1e-9), to_side)
    return " ".join(f"{value:.3f}" for value in ranges)


def test_the_way_out_for_a_log_without_odometry_follows_the_robot_by_its_scans(
    tmp_path: Path, in_process: Command
) -> None:
    corrected = [laser((0.1 * n, 0, 0), (0.1 * n, 0, 0), 1.0 + 0.2 * n, room_scan(0.1 * n)) for n in range(21)]
    log, out, poses = written(tmp_path, [*corrected, "NEFF 3"]), tmp_path / "o.mcap", tmp_path / "poses"
    code, _, errors = in_process("import", str(log), "--out", str(out))
    assert code != 0 and "with --poses corrected, or the scans alone, with --poses none, and follow" in errors
    command = errors.split("`")[1].split()
    assert in_process("import", str(log), "--out", str(out), "--poses", "none")[0] == 0
    assert in_process(*command[1:], "--out", str(poses))[0] == 0
    last = (poses / "poses.csv").read_text().splitlines()[-1].split(",")
    assert (float(last[4]), float(last[5])) == pytest.approx((2.0, 0.0), abs=0.2)  # 20 steps of 0.1 m


def test_odometry_that_never_changes_is_named(tmp_path: Path, in_process: Command) -> None:
    zero = (0.0, 0.0, 0.0)
    log = written(tmp_path, [line for n in range(3) for line in (odom(zero, 1.0 + n), laser(zero, zero, 1.5 + n))])
    _, said, _ = in_process("import", str(log), "--out", str(tmp_path / "o.mcap"))
    assert "odometry: it stands still; if the robot moved, follow its scans with `navloom replay" in said


def test_a_period_counts_the_scans_of_one_laser_and_spreads_the_other_lines(tmp_path: Path) -> None:
    zero = (0.0, 0.0, 0.0)
    lines = []
    for number in range(4):
        lines += [odom((0.1 * number, 0, 0), 9.76053e8), odom((0.1 * number + 0.05, 0, 0), 9.76053e8)]
        lines += [laser(zero, zero, 9.76053e8), laser(zero, zero, 9.76053e8, word="RLASER")]
    lines += [odom((0.4, 0, 0), 9.76053e8), odom((0.45, 0, 0), 9.76053e8)]
    odometry, scans = imported(tmp_path, lines, period=0.4)
    # Four lines between two scans of the front laser, 0.1 s apart; two lines before the first scan.
    assert [scan.stamp_ns for scan in scans[::2]] == [400_000_000, 800_000_000, 1_200_000_000, 1_600_000_000]
    assert [round(one.stamp_ns * 1e-9, 3) for one in odometry if one.stamp_ns < 400_000_000] == [0.2, 0.3]
    assert odometry[-1].stamp_ns == 1_900_000_000  # three lines after the last scan


@pytest.mark.parametrize("word", ["RLASER", "FLASER"])
def test_scans_of_a_robot_that_stands_need_no_odometry_between_them(tmp_path: Path, word: str) -> None:
    """Two lasers in a corrected log, and scans before the first odometry."""
    start, place = np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, math.radians(80.0)])
    lines = [laser(start, start, 1.0), laser(start, start, 1.2, word=word), odom(place, 1.5), "NEFF 12.5"]
    for number in range(20):
        place = compose(place, np.array([0.1, 0.0, 0.0]))
        lines.append(odom(place, 2.0 + 0.1 * number))
        if number % 5 == 4:
            lines += [laser(place, place, 2.01 + 0.1 * number), laser(place, place, 2.02 + 0.1 * number, word=word)]
            lines.append(odom(place, 0.0))
    odometry, scans = imported(tmp_path, lines)
    last = odometry[-1].pose
    assert len(scans) == 10 and math.degrees(last.heading) == pytest.approx(80.0)
    assert math.hypot(last.x, last.y) == pytest.approx(2.0)  # 20 steps of 0.1 m


def test_both_streams_with_times_of_no_clock_are_named(tmp_path: Path) -> None:
    zero = (0.0, 0.0, 0.0)
    lines = [line for n in range(5) for line in (odom((0.1 * n, 0, 0), 7.0), laser(zero, zero, 7.0))]
    why = r"scans: its 5 messages all have the stamp 7; odometry: its 5 messages all have the stamp 7; number"
    with pytest.raises(RecordingError, match=why):
        imported(tmp_path, lines)


def test_times_that_leap_are_named_with_their_line(tmp_path: Path, in_process: Command) -> None:
    zero = (0.0, 0.0, 0.0)
    lines = [odom((0.1, 0, 0), 1.0), laser(zero, zero, 2.0), odom((0.2, 0, 0), 1002.0), laser(zero, zero, 1003.0)]
    _, said, _ = in_process("import", str(written(tmp_path, lines)), "--out", str(tmp_path / "o.mcap"))
    assert "its times leap by 1000 s at line 3: if the clock was set there, or the robot moved, cut the log" in said
