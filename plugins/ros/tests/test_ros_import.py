"""Import of ROS bags: conventions of ranges, mounts, clouds, which topics are imported or skipped, and maps."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import ros_bags as bags
from navloom.cli.main import app
from navloom.messages import Odometry, RangeScan, Sweep
from navloom_recording.reader import Recording
from navloom_recording.recording_header import RecordingError
from navloom_ros.bag_import import import_bag
from navloom_ros.bags import messages as bag_messages
from navloom_ros.frames import Mount, quaternion_matrix
from typer.testing import CliRunner

HERE = Mount(np.eye(3), np.zeros(3))


def bag_path(folder: Path, ros: int) -> Path:
    return folder / ("room.bag" if ros == 1 else "room")


def one_bag(folder: Path, fill: Any) -> Path:
    """A ROS 2 bag with odometry, and what `fill` writes into it."""
    path = bag_path(folder, 2)
    with bags.Bag(path, 2) as bag:
        bag.put("/odom", bag.odometry(0.0, bags.START_NS), bags.START_NS)
        fill(bag)
    return path


def bare_database(bag: Path, *changes: str) -> Path:
    """The database of a ROS 2 bag after SQL statements; the bag's description, which has checksums, is deleted."""
    (bag / "metadata.yaml").unlink()
    (path,) = bag.glob("*.db3")
    with closing(sqlite3.connect(path)) as database, database:
        for change in changes:
            assert database.execute(change).rowcount > 0
    return path


@pytest.mark.parametrize("ros", [1, 2])
def test_a_drive_is_imported_with_its_stamps_and_mounts(tmp_path: Path, ros: int) -> None:
    found = import_bag(bags.room_bag(bag_path(tmp_path, ros), ros), tmp_path / "a.mcap")
    taken = {topic.name: (topic.sensor, topic.messages) for topic in found.topics}
    assert taken == {"/chatter": ("", 0), "/odom": ("odometry", 40), "/scan": ("scan", 40), "/tf_static": ("mounts", 1)}
    assert dict(found.topics[0].skipped) == {"not a type that is read": 1}
    recording = Recording(tmp_path / "a.mcap")
    assert recording.header.kind == "imported" and recording.keys()[0] == "imported/room/platform/recorded/odometry"
    messages = list(recording.messages())
    poses = [message.message for message in messages if isinstance(message.message, Odometry)]
    assert [pose.stamp_ns for pose in poses] == [stamp for _, stamp in bags.times()]
    assert poses[-1].pose.x == pytest.approx(0.5 * 3.9) and poses[-1].twist.vx == 0.5
    scan = next(message.message for message in messages if isinstance(message.message, RangeScan))
    # The laser points to the left: its first beam points ahead, to the wall at 4.8 m; its last one back, to 1.2 m.
    assert scan.origins[0].tolist() == pytest.approx([0.2, 0.0])
    assert scan.bearings[[0, 90]].tolist() == pytest.approx([0.0, math.pi / 2], abs=1e-6)
    assert scan.ranges[[0, 90, 180]].tolist() == pytest.approx([4.8, 2.0, 1.2], abs=1e-3)
    assert messages[-1].envelope.tick == 78


def test_ranges_follow_rep_117(tmp_path: Path) -> None:
    given = [1.0, math.inf, -math.inf, math.nan, 0.05, 0.0, 9.0, 8.0, 7.5]

    def fill(bag: Any) -> None:
        bag.put("/scan", bag.scan(given, bags.START_NS, "base_link", 8.0), bags.START_NS)

    found = import_bag(one_bag(tmp_path, fill), tmp_path / "a.mcap", mounts={"scan": HERE})
    scan = next(o.message for o in Recording(tmp_path / "a.mcap").messages() if isinstance(o.message, RangeScan))
    assert scan.ranges.tolist() == pytest.approx([1.0, math.inf, 0.1, math.inf, math.inf, 7.5])
    step = math.pi / 8
    beams = [0, 1, 2, 6, 7, 8]
    assert scan.bearings.tolist() == pytest.approx([-math.pi / 2 + step * beam for beam in beams], abs=1e-6)
    assert (scan.range_min, scan.range_max) == (pytest.approx(0.1), 8.0) and found.topics[1].messages == 1


def test_a_sonar_is_one_wide_beam(tmp_path: Path) -> None:
    def fill(bag: Any) -> None:
        for number, value in enumerate((1.5, math.inf, math.nan)):
            bag.put("/sonar/front", bag.range(value, bags.START_NS + number, "base_link"), bags.START_NS + number)

    left = Mount(quaternion_matrix(0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)), np.array([0.1, 0.2, 0.3]))
    found = import_bag(one_bag(tmp_path, fill), tmp_path / "a.mcap", {"/sonar/front": "front"}, {"front": left})
    scans = [o.message for o in Recording(tmp_path / "a.mcap").messages() if isinstance(o.message, RangeScan)]
    assert [float(scan.ranges[0]) for scan in scans] == [1.5, math.inf]
    assert scans[0].half_angles.tolist() == pytest.approx([0.2]) and scans[0].origins.tolist() == [[0.1, 0.2]]
    assert scans[0].bearings.tolist() == pytest.approx([math.pi / 2])
    topic = next(topic for topic in found.topics if topic.name == "/sonar/front")
    assert dict(topic.skipped) == {"a range that is NaN": 1}


def cloud_points(rows: Any, columns: Any, distance: float = 3.0) -> Any:
    """(rows · columns, 3) points at one distance, m, row by row."""
    up, round_ = np.meshgrid(np.asarray(rows), np.asarray(columns), indexing="ij")
    level = distance * np.cos(up)
    return np.stack([level * np.cos(round_), level * np.sin(round_), distance * np.sin(up)], axis=-1).reshape(-1, 3)


def test_an_organised_cloud_keeps_its_rows_and_columns(tmp_path: Path) -> None:
    rows, columns = np.radians([10.0, 0.0, -10.0]), np.radians([40.0, 20.0, 0.0, -20.0])
    points = cloud_points(rows, columns)
    points[5] = math.nan

    def fill(bag: Any) -> None:
        bag.put("/cloud", bag.cloud(points, 3, bags.START_NS, "base_link"), bags.START_NS)

    import_bag(
        one_bag(tmp_path, fill), tmp_path / "a.mcap", mounts={"cloud": Mount(np.eye(3), np.array([0.1, 0, 0.5]))}
    )
    sweep = next(o.message for o in Recording(tmp_path / "a.mcap").messages() if isinstance(o.message, Sweep))
    assert sweep.pitches.tolist() == pytest.approx(sorted(rows), abs=1e-6)
    assert sweep.bearings.tolist() == pytest.approx(sorted(columns), abs=1e-6)
    assert sweep.geometry == "paper" and (sweep.x, sweep.z) == (0.1, 0.5)
    # Point 5 was row 1, column 1 (0°, 20°): rows and columns now ascend, so it is at (1, 2).
    assert np.isinf(sweep.ranges[1, 2]) and np.isinf(sweep.ranges).sum() == 1
    assert sweep.ranges[0].tolist() == pytest.approx([3.0] * 4, abs=1e-5)


def test_a_cloud_without_rows_is_put_into_a_raster_where_the_nearest_counts(tmp_path: Path) -> None:
    points = np.concatenate([cloud_points(np.radians([0.5]), np.radians([0.25, 10.25])),
                             cloud_points(np.radians([0.5]), np.radians([0.25]), 2.0)])  # fmt: skip

    def fill(bag: Any) -> None:
        bag.put("/cloud", bag.cloud(points, 1, bags.START_NS, "base_link"), bags.START_NS)

    import_bag(one_bag(tmp_path, fill), tmp_path / "a.mcap", mounts={"cloud": HERE})
    sweep = next(o.message for o in Recording(tmp_path / "a.mcap").messages() if isinstance(o.message, Sweep))
    assert sweep.ranges.shape == (1, 21) and np.isfinite(sweep.ranges).sum() == 2
    assert sweep.ranges[0, [0, 20]].tolist() == pytest.approx([2.0, 3.0], abs=1e-5)
    assert np.degrees(sweep.bearings[[0, 20]]).tolist() == pytest.approx([0.25, 10.25])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"width": 0}, "it has no points"),
        ({"height": 2**32 - 1, "row_step": 1}, "its 12 bytes do not hold 4294967295 rows of 1 points"),
        ({"point_step": 8}, "its 12 bytes do not hold 1 rows of 1 points, 8 bytes each"),
        ({"data": np.zeros(11, dtype=np.uint8)}, "its 11 bytes do not hold 1 rows of 1 points, 12 bytes each"),
        ({"fields": 9}, "its field x has datatype 9, expected 1 to 8"),
    ],
)
def test_a_cloud_that_contradicts_itself_is_skipped_with_the_reason(
    tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    def fill(bag: bags.Bag) -> None:
        good = bag.cloud(cloud_points(np.radians([0.5]), np.radians([0.25])), 1, bags.START_NS, "base_link")
        bad = bag.cloud(cloud_points(np.radians([0.5]), np.radians([0.25])), 1, bags.START_NS, "base_link")
        if "fields" in change:
            change["fields"] = [bag.type("sensor_msgs/msg/PointField")(name, 0, change["fields"], 1) for name in "xyz"]
        bag.put("/cloud", good, bags.START_NS)
        bag.put("/cloud", dataclasses.replace(bad, **change), bags.START_NS + 1)

    found = import_bag(one_bag(tmp_path, fill), tmp_path / "a.mcap", mounts={"cloud": HERE})
    (cloud,) = (topic for topic in found.topics if topic.name == "/cloud")
    assert cloud.messages == 1 and [text[: len(reason)] for text in cloud.skipped] == [reason]


def test_a_range_of_a_bag_without_definitions_is_read_as_the_releases_that_wrote_such_bags_did(
    tmp_path: Path,
) -> None:
    def fill(bag: bags.Bag) -> None:
        bag.put("/sonar", bag.range(1.5, bags.START_NS, "base_link"), bags.START_NS)

    database = bare_database(one_bag(tmp_path, fill), "UPDATE schema SET schema_version = 3")
    found = import_bag(database, tmp_path / "a.mcap", mounts={"sonar": HERE})
    assert [topic.messages for topic in found.topics if topic.name == "/sonar"] == [1]


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("float32 angle_increment", "float32 angle_incrxment", "sensor_msgs/msg/LaserScan.*'angle_increment'"),
        ("float32 range_max", "float64 range_max", "sensor_msgs/msg/LaserScan.*'range_max'"),
        ("string frame_id", "string frame_it", "std_msgs/msg/Header.*'frame_id'"),
    ],
)
def test_a_bag_that_redefines_a_message_type_is_refused(tmp_path: Path, old: str, new: str, named: str) -> None:
    text = "encoded_message_definition"
    database = bare_database(
        bags.room_bag(bag_path(tmp_path, 2), 2),
        f"UPDATE message_definitions SET {text} = replace({text}, {old!r}, {new!r})",
        "UPDATE topics SET type_description_hash = ''",
    )
    with pytest.raises(RecordingError, match=f"defines {named}"):
        import_bag(database, tmp_path / "a.mcap")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("UPDATE topics SET name = x'00ff' WHERE name = '/scan'", "the name or type of a topic is not text"),
        ("UPDATE messages SET timestamp = -1", "a message of /[a-z_]+ has the time -1; copy the bag again"),
        ("UPDATE messages SET timestamp = 'noon'", r"room\.db3: not a bag that can be read"),
    ],
)
def test_a_database_with_values_of_another_type_is_refused(tmp_path: Path, change: str, reason: str) -> None:
    database = bare_database(bags.room_bag(bag_path(tmp_path, 2), 2), change)
    with pytest.raises(RecordingError, match=reason):
        import_bag(database, tmp_path / "a.mcap")
    assert not (tmp_path / "a.mcap").exists()


def test_a_transform_from_odom_is_odometry_where_there_is_no_topic(tmp_path: Path) -> None:
    path = bag_path(tmp_path, 2)
    with bags.Bag(path, 2) as bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", 0.2, 0.0, bags.START_NS), bags.START_NS)
        for x, stamp_ns in bags.times():
            bag.put("/tf", bag.transform("odom", "base_link", x, 0.0, stamp_ns), stamp_ns)
            bag.put("/scan", bag.scan(bags.ranges_at(x), stamp_ns), stamp_ns)
    import_bag(path, tmp_path / "a.mcap")
    poses = [o.message for o in Recording(tmp_path / "a.mcap").messages() if isinstance(o.message, Odometry)]
    assert len(poses) == 40 and poses[-1].pose.x == pytest.approx(1.95)
    assert poses[0].twist.vx == 0.0 and poses[-1].twist.vx == pytest.approx(0.5, abs=1e-6)


def test_what_cannot_be_imported_is_refused_with_the_reason(tmp_path: Path) -> None:
    def no_mount(bag: Any) -> None:
        bag.put("/scan", bag.scan([1.0, 1.0], bags.START_NS, "nowhere"), bags.START_NS)

    path = one_bag(tmp_path, no_mount)
    out = tmp_path / "a.mcap"
    for options, why in (
        ({}, r"no transform from nowhere to base_link: give --mount scan=X,Y,YAW_DEG"),
        ({"mounts": {"laser": HERE}}, r"--mount laser: the bag has no such sensor; it has scan"),
        ({"names": {"/other": "x"}}, r"has no topic '/other'; it has /odom, /scan"),
        ({"names": {"/scan": "odometry"}}, r"'odometry' cannot name a sensor"),
        ({"odometry_topic": "/scan"}, r"topic '/scan' is not a nav_msgs/msg/Odometry; there are /odom"),
    ):
        with pytest.raises(RecordingError, match=why):
            import_bag(path, out, **options)  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match="no such bag"):
        import_bag(tmp_path / "none.bag", out)
    (tmp_path / "broken.bag").write_bytes(b"#ROSBAG V2.0\nnothing")
    with pytest.raises(RecordingError, match="not a bag that can be read"):
        import_bag(tmp_path / "broken.bag", out)
    assert not out.exists()


def refusal(bag: Path, out: Path, **options: Any) -> str:
    with pytest.raises(RecordingError) as caught:
        import_bag(bag, out, **options)
    return str(caught.value)


def test_a_bag_whose_laser_has_no_mount_is_refused_with_what_is_missing_and_nothing_else(tmp_path: Path) -> None:
    path = bag_path(tmp_path, 2)
    with bags.Bag(path, 2) as bag:
        for x, stamp_ns in bags.times():
            bag.put("/odom", bag.odometry(x, stamp_ns), stamp_ns)
            bag.put("/scan", bag.scan(bags.ranges_at(x), stamp_ns), stamp_ns)
    assert refusal(path, tmp_path / "a.mcap") == (
        "no topic with ranges can be used: /scan (sensor_msgs/msg/LaserScan): "
        "no transform from laser to base_link: give --mount scan=X,Y,YAW_DEG"
    )


def test_a_bag_without_ranges_is_refused_with_the_types_that_are_read(tmp_path: Path) -> None:
    assert refusal(one_bag(tmp_path, lambda bag: None), tmp_path / "a.mcap") == (
        "no topic with ranges can be used: expected one of sensor_msgs/msg/LaserScan, sensor_msgs/msg/Range, "
        "sensor_msgs/msg/PointCloud2; the bag has /odom (nav_msgs/msg/Odometry)"
    )


def test_a_localizer_runs_on_an_imported_log_in_a_map_that_is_given(tmp_path: Path) -> None:
    """Odometry is 5 % too long, 0.1 m in total; the localizer corrects it with the scans and the map of the room."""
    path, out, world = bag_path(tmp_path, 2), tmp_path / "a.mcap", tmp_path / "room.toml"
    with bags.Bag(path, 2) as bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", bags.MOUNT_X, bags.MOUNT_YAW, bags.START_NS),
                bags.START_NS)  # fmt: skip
        for x, stamp_ns in bags.times():
            bag.put("/odom", bag.odometry(7.0 + 1.05 * x, stamp_ns), stamp_ns)
            bag.put("/scan", bag.scan(bags.ranges_at(x), stamp_ns), stamp_ns)
    walls = ("[-1.2, -1.0], y = [-2.2, 2.2]", "[5.0, 5.2], y = [-2.2, 2.2]",
             "[-1.2, 5.2], y = [-2.2, -2.0]", "[-1.2, 5.2], y = [2.0, 2.2]")  # fmt: skip
    text = "".join(f'[[box]]\nname = "wall {number}"\nx = {wall}\n' for number, wall in enumerate(walls))
    world.write_text(f"bounds = [-2.0, -3.0, 6.0, 3.0]\n{text}".replace(", y = ", "\ny = "))
    import_bag(path, out)
    command = ["replay", str(out), "--localizer", "scan_matching"]
    run = CliRunner()
    lacking = run.invoke(app, command)
    assert lacking.exit_code != 0 and "--map" in str(lacking.exception)
    kept = tmp_path / "o"
    found = run.invoke(app, [*command, "--map", str(world), "--start", "0,0,0", "--out", str(kept), "--json"])
    assert found.exit_code == 0, found.output
    summary = json.loads(found.stdout)["localizer"]
    assert summary["instance"] == "scan_matching" and summary["poses"] == 40
    assert summary["position"]["end"] == pytest.approx(0.05 * 1.95, abs=0.03)
    rows = np.loadtxt(kept / "poses.csv", delimiter=",", skiprows=1, usecols=range(7))
    assert rows[0, 1:4].tolist() == pytest.approx([0.0, 0.0, 0.0])
    assert rows[-1, 1] == pytest.approx(1.05 * 1.95) and rows[-1, 4] == pytest.approx(1.95, abs=0.03)
    told = run.invoke(app, [*command, "--map", str(world), "--start", "0,0,0"])
    assert "localizer scan_matching: 40 poses" in told.output and "no map" not in told.output
    assert "expected X,Y,HEADING_DEG" in str(run.invoke(app, [*command, "--start", "0,nan"]).exception)


def test_the_map_of_an_import_travels_with_the_recording(tmp_path: Path) -> None:
    run, folder = CliRunner(), tmp_path / "map"
    bag, out = bags.room_bag(bag_path(tmp_path, 2), 2), tmp_path / "a.mcap"
    folder.mkdir()
    (folder / "room.pgm").write_bytes(b"P5 8 8 255\n" + bytes([254] * 64))
    (folder / "room.yaml").write_text(
        "image: room.pgm\nresolution: 1.0\norigin: [-2.0, -4.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    command = ["ros", "import", str(bag), "--out", str(out), "--map", str(folder / "room.yaml"), "--start", "0,0,90"]
    done = run.invoke(app, command)
    assert done.exit_code == 0, done.output
    (folder / "room.pgm").unlink()
    (folder / "room.yaml").unlink()
    found = run.invoke(
        app, ["replay", str(out), "--localizer", "scan_matching", "--out", str(tmp_path / "o"), "--json"]
    )
    assert found.exit_code == 0, found.output
    rows = np.loadtxt(tmp_path / "o" / "poses.csv", delimiter=",", skiprows=1, usecols=range(7))
    # The robot drove 1.95 m along the odometry's x axis, which is the map's y axis.
    assert rows[-1, 1:4].tolist() == pytest.approx([0.0, 1.95, math.pi / 2])


def test_an_import_on_a_full_disk_leaves_nothing_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: Callable[..., tuple[int, str, str]]
) -> None:
    bag, out = bags.room_bag(bag_path(tmp_path, 2), 2), tmp_path / "a.mcap"
    real, written = os.write, [0]

    def full(descriptor: int, data: bytes) -> int:
        written[0] += len(data)
        if written[0] > 4_000:  # after the header, which holds the config
            raise OSError(28, "No space left on device")
        return real(descriptor, data)

    monkeypatch.setattr("navloom_recording.writer.os.write", full)
    code, said, errors = in_process("ros", "import", str(bag), "--out", str(out))
    monkeypatch.undo()
    assert (code, said) == (1, "") and not out.exists()
    assert errors == f"navloom: {out}: No space left on device; nothing of the import is kept\n"
    assert in_process("ros", "import", str(bag), "--out", str(out))[0] == 0
    size = out.stat().st_size
    code, _, errors = in_process("ros", "import", str(bag), "--out", str(out))
    assert code == 2 and "there is such a file already; name another, or remove it" in errors
    assert out.stat().st_size == size


def test_an_imported_log_gives_a_map_and_an_avoider_is_compared_with_the_driver(tmp_path: Path) -> None:
    bag, out = bags.room_bag(bag_path(tmp_path, 2), 2), tmp_path / "a.mcap"
    run = CliRunner()
    told = run.invoke(app, ["ros", "import", str(bag), "--out", str(out), "--json"])
    assert told.exit_code == 0 and json.loads(told.stdout)["seconds"] == pytest.approx(3.9)
    found = run.invoke(
        app, ["replay", str(out), "--mapper", "scan_grid", "--avoider", "vff", "--out", str(tmp_path / "o"), "--json"]
    )
    assert found.exit_code == 0, found.output
    summary = json.loads(found.stdout)
    # The scans cover walls of at least 4 + 2 + 2 m, one or two cells of 0.05 m thick.
    assert 160 < summary["map"]["occupied"] < 500 and summary["driven_m"] == pytest.approx(1.95)
    assert summary["avoider"]["ticks"] > 30 and summary["avoider"]["against"] == ["the driver"]
    kept = {path.name for path in (tmp_path / "o").iterdir()}
    assert kept == {"result.json", "map.png", "map.yaml", "map.pgm", "avoider.png", "ticks.csv"}
    plain = run.invoke(app, ["replay", str(out)])
    assert plain.exit_code != 0 and "name what to try on it" in str(plain.exception)


def test_a_bag_whose_connections_share_a_number_is_damaged(tmp_path: Path) -> None:
    laser, words = (
        SimpleNamespace(topic=topic, msgtype=kind)
        for topic, kind in (("/scan", "sensor_msgs/msg/LaserScan"), ("/words", "std_msgs/msg/String"))
    )
    reader = SimpleNamespace(bag=tmp_path / "a.bag", messages=lambda connections: iter([(words, 0, b"")]))
    with pytest.raises(RecordingError, match=r"a\.bag: damaged: .*a message of /words is of std_msgs/msg/String"):
        list(bag_messages(reader, [laser]))
