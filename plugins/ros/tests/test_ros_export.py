"""Export of a recording as a ROS file: frames, numbers that can be checked by hand, and third-party readers."""

import math
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from navloom import (
    Command,
    Envelope,
    GateStatus,
    MapUpdate,
    OccupancyGrid,
    Odometry,
    PoseEstimate,
    RangeScan,
    Selection,
    Sweep,
    Twist2D,
)
from navloom import Path as PlannedPath
from navloom import Pose2D as Pose
from navloom.config import load_config
from navloom.messages import StopReason
from navloom.messages.codec import encode, schema_label
from navloom_recording.recording_header import RecordingHeader
from navloom_recording.writer import RecordingWriter
from navloom_ros.adapter import export
from navloom_ros.cli import app
from navloom_ros.errors import RosError
from navloom_ros.translating import TOPICS, Translator
from ros_golden import KILTED
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

HALF = math.pi / 2


def scan(bearings, ranges, half_angle=0.0, offsets=None):
    count = len(bearings)
    origins = np.tile([0.2, -0.1], (count, 1))
    offsets = np.zeros(count) if offsets is None else np.asarray(offsets)
    return RangeScan(
        0, origins, np.asarray(bearings), np.full(count, half_angle), offsets, np.asarray(ranges), 0.05, 8.0
    )


def odometry(x, y, heading):
    return Odometry(0, Pose(x, y, heading), Twist2D(0.3, 0.0, 0.1))


def estimate(x, y, heading):
    return PoseEstimate(0, Pose(x, y, heading), Twist2D(0.0, 0.0, 0.0), np.diag([0.04, 0.09, 0.01]))


def one(role, port, message, translator=None, instance="main", stamp_ns=1_500_000_000):
    made = (translator or Translator(KILTED)).translate(role, instance, port, message, stamp_ns)
    return {entry.topic: entry.message for entry in made}


def test_odometry_is_a_pose_in_odom_and_a_transform():
    made = one("platform", "odometry", odometry(1.0, 2.0, HALF))
    odom, (transform,) = made["/odom"], made["/tf"].transforms
    assert (odom.header.stamp.sec, odom.header.stamp.nanosec, odom.header.frame_id) == (1, 500_000_000, "odom")
    assert (odom.child_frame_id, odom.pose.pose.position.y, odom.twist.twist.linear.x) == ("base_link", 2.0, 0.3)
    assert odom.pose.pose.orientation.z == pytest.approx(math.sqrt(0.5))
    assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link")
    assert transform.transform.translation.x == 1.0


def test_map_to_odom_closes_the_chain():
    """Base is at (5, 5) facing up in the map, and at (1, 2) facing up in odom: odom is at (4, 3), not rotated."""
    translator = Translator(KILTED)
    one("platform", "odometry", odometry(1.0, 2.0, HALF), translator)
    made = one("localizer", "pose", estimate(5.0, 5.0, HALF), translator)
    (transform,) = made["/tf"].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "odom")
    moved = transform.transform.translation
    assert (moved.x, moved.y, transform.transform.rotation.z) == pytest.approx((4.0, 3.0, 0.0))
    turned = one("localizer", "pose", estimate(0.0, 0.0, -HALF), translator)["/tf"].transforms[0].transform
    assert (turned.translation.x, turned.translation.y) == pytest.approx((1.0, 2.0))  # turned by 180 degrees
    covariance = made["/pose"].pose.covariance.reshape(6, 6)
    assert (covariance[0, 0], covariance[1, 1], covariance[5, 5]) == (0.04, 0.09, 0.01)


@pytest.mark.parametrize("order", [1, -1])
def test_a_laser_is_a_scan_in_its_own_frame_whichever_way_it_turns(order):
    translator = Translator(KILTED)
    message = scan([-1.0, 0.0, 1.0][::order], [1.0, math.inf, 3.0][::order], offsets=[0.0, 0.01, 0.02])
    made = one("platform", "laser", message, translator)
    laser, (mount,) = made["/laser"], made["/tf_static"].transforms
    assert laser.ranges.tolist() == [1.0, math.inf, 3.0]
    assert (laser.angle_min, laser.angle_max, laser.angle_increment) == pytest.approx((-1.0, 1.0, 1.0))
    assert laser.time_increment == pytest.approx(0.01 if order == 1 else 0.0)
    assert (laser.header.frame_id, mount.header.frame_id, mount.child_frame_id) == ("laser", "base_link", "laser")
    assert (mount.transform.translation.x, mount.transform.translation.y) == (0.2, -0.1)
    assert "/tf_static" not in one("platform", "laser", message, translator)


def test_a_laser_across_the_back_is_one_scan():
    made = one("platform", "laser", scan([math.pi - 0.1, -math.pi, -math.pi + 0.1], [1.0, 2.0, 3.0]))
    assert (made["/laser"].angle_min, made["/laser"].angle_max) == pytest.approx((math.pi - 0.1, math.pi + 0.1))


def test_sonars_are_ranges_each_in_its_frame_and_all_mounts_are_told_again():
    made = one("platform", "sonars", scan([0.0, HALF], [1.5, math.inf], half_angle=0.2))
    first, second = made["/sonars/beam_0"], made["/sonars/beam_1"]
    assert (first.range, first.field_of_view, second.range) == pytest.approx((1.5, 0.4, math.inf))
    assert first.header.frame_id == "sonars_0"
    mounts = made["/tf_static"].transforms
    assert [mount.child_frame_id for mount in mounts] == ["sonars_0", "sonars_1"]
    assert mounts[1].transform.rotation.z == pytest.approx(math.sqrt(0.5))


def points_of(cloud):
    return np.frombuffer(cloud.data, "<f4").reshape(cloud.width, 3)


def test_other_scanners_are_points_without_what_saw_nothing():
    cloud = one("platform", "odd", scan([0.0, 0.3, HALF], [1.0, math.inf, 2.0]))["/odd/points"]
    assert points_of(cloud) == pytest.approx(np.array([[1.2, -0.1, 0.0], [0.2, 1.9, 0.0]]), abs=1e-6)
    assert (cloud.point_step, cloud.row_step, [field.name for field in cloud.fields]) == (12, 24, ["x", "y", "z"])


@pytest.mark.parametrize(
    ("geometry", "expected"),
    [("paper", [0.5, 0.5, math.sqrt(0.5)]), ("rigid_pitch", [0.5, math.sqrt(0.5), 0.5])],
)
def test_a_sweep_is_a_cloud_by_its_geometry(geometry, expected):
    """One echo at 1 m, pitched 45 degrees up and 45 degrees to the left."""
    angle = np.array([math.pi / 4])
    sweep = Sweep(0, 1, np.array([[1.0]]), angle, np.zeros(1), angle, geometry, 0.1, 0.0, 0.4, 0.1, 8.0)
    (point,) = points_of(one("platform", "laser", sweep)["/laser/points"])
    assert point == pytest.approx(np.array(expected) + (0.1, 0.0, 0.4), abs=1e-6)


def test_a_map_keeps_rows_from_below_and_its_segments():
    grid = OccupancyGrid(np.array([[0, 100], [-1, 50], [0, 0]], np.int8), 0.25, Pose(-1.0, -2.0, 0.0))
    made = one("mapper", "map", MapUpdate(0, grid, np.array([[0.0, 0.0, 1.0, 2.0]]), ()))
    raster = made["/map"]
    assert (raster.info.width, raster.info.height, raster.info.resolution) == (2, 3, 0.25)
    assert raster.data.tolist() == [0, 100, -1, 50, 0, 0] and raster.info.origin.position.y == -2.0
    (marker,) = made["/map/segments"].markers
    assert [(point.x, point.y) for point in marker.points] == [(0.0, 0.0), (1.0, 2.0)]


@pytest.mark.parametrize("count", [1, 3])
def test_a_plan_faces_where_it_goes(count):
    points = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]])[:count]
    poses = one("planner", "path", PlannedPath(1, points, 2.0, None))["/plan"].poses
    turns = [2.0 * math.atan2(pose.pose.orientation.z, pose.pose.orientation.w) for pose in poses]
    assert turns == pytest.approx([HALF, 0.0, 0.0] if count == 3 else [0.0])


def test_a_plan_with_headings_faces_as_the_base_does():
    plan = PlannedPath(1, np.array([[0.0, 0.0], [-1.0, 0.0]]), 1.0, None, np.array([0.0, HALF]))
    poses = one("planner", "path", plan)["/plan"].poses
    turns = [2.0 * math.atan2(pose.pose.orientation.z, pose.pose.orientation.w) for pose in poses]
    assert turns == pytest.approx([0.0, HALF])


def test_the_gate_says_why_it_stopped():
    status = GateStatus("none", "", True, False, StopReason.parse("stale: controller"), ())
    (told,) = one("gate", "status", status)["/diagnostics"].status
    assert (told.level, told.message) == (1, "stopped: stale: controller")


def test_only_the_active_instance_is_told_and_what_is_left_out_is_counted():
    translator = Translator(KILTED)
    one("gate", "selection", Selection(1, 0, ("controller a",)), translator)
    command = Command(Twist2D(0.1, 0.0, 0.0))
    assert one("controller", "command", command, translator, instance="a")
    assert not one("controller", "command", command, translator, instance="b")
    assert translator.left_out == {"gate/selection": 1, "controller/command": 1}


def recorded(path, clock="run", count=5):
    header = RecordingHeader("lab", "r1", "lockstep", 0.05, 1, clock)
    ahead = 0 if clock == "run" else 1_700_000_000_000_000_000
    with RecordingWriter(path, header) as writer:
        for number in range(count):
            stamp = number * 50_000_000
            for role, port, message in (
                ("platform", "odometry", odometry(0.1 * number, 0.0, 0.0)),
                ("platform", "laser", scan([-0.5, 0.0, 0.5], [1.0, 2.0, 3.0])),
                ("localizer", "pose", estimate(0.1 * number, 1.0, 0.0)),
                ("gate", "command", Command(Twist2D(0.2, 0.0, 0.0))),
            ):
                key = f"lab/r1/{role}/main/{port}"
                data = encode(message, Envelope(key, number, number, stamp, stamp, 0))
                writer.add(key, schema_label(type(message)), data, stamp + ahead, stamp, number)
    return path


def test_rosbags_and_mcap_read_every_message(tmp_path):
    out = tmp_path / "out.mcap"
    done = export(recorded(tmp_path / "run.mcap"), out, KILTED)
    assert done["messages"] == {"/odom": 5, "/tf": 10, "/laser": 5, "/tf_static": 1, "/pose": 5, "/cmd_vel": 5}
    with AnyReader([out]) as bag:
        read = [(link.topic, stamp, bag.deserialize(data, link.msgtype)) for link, stamp, data in bag.messages()]
    assert len(read) == 31
    assert [message.pose.pose.position.x for topic, _, message in read if topic == "/odom"] == pytest.approx(
        [0.0, 0.1, 0.2, 0.3, 0.4]
    )
    with out.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert b"MSG: std_msgs/Header" in next(
        s.data for s in summary.schemas.values() if s.name == "nav_msgs/msg/Odometry"
    )


@pytest.mark.parametrize(("mapper", "expected"), [("ipabd", [(1.0, 0.0, 0.4)]), ("scan_grid", None)])
def test_what_ipabd_kept_of_a_sweep_is_a_cloud(tmp_path, mapper, expected):
    """Three echoes on one bearing: 1 m away at 0.4 m height, 3 m away behind it, and the floor in front of it."""
    config = load_config("paper", [f"mapper.plugin={mapper}"]).to_json()
    ranges, pitches = np.array([[1.0], [3.0], [0.5]]), np.array([0.0, 0.0, -math.asin(0.8)])
    sweep = Sweep(0, 1, ranges, pitches, np.zeros(3), np.zeros(1), "paper", 0.0, 0.0, 0.4, 0.1, 8.0)
    source, out = tmp_path / "run.mcap", tmp_path / "out.mcap"
    with RecordingWriter(source, RecordingHeader("lab", "r1", "lockstep", 0.05, 1, "run", config)) as writer:
        key = "lab/r1/platform/main/laser"
        writer.add(key, schema_label(Sweep), encode(sweep, Envelope(key, 0, 0, 0, 0, 0)), 0, 0, 0)
    export(source, out, KILTED)
    with AnyReader([out]) as bag:
        read = {link.topic: bag.deserialize(data, link.msgtype) for link, _, data in bag.messages()}
    assert len(points_of(read["/laser/points"])) == 3
    kept = read.get("/laser/kept")
    assert (kept and points_of(kept).tolist()) == (expected and [pytest.approx(one) for one in expected])


def test_a_live_recording_keeps_its_wall_clock_as_one_timeline(tmp_path):
    out = tmp_path / "out.mcap"
    export(recorded(tmp_path / "run.mcap", clock="wall"), out, KILTED)
    with AnyReader([out]) as bag:
        times = [
            (stamp, message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            for link, stamp, data in bag.messages()
            if link.topic == "/odom"
            for message in [bag.deserialize(data, link.msgtype)]
        ]
    assert times[0][0] == 1_700_000_000_000_000_000 and all(at == stamp for at, stamp in times)


def test_nothing_is_written_over_and_nothing_is_left_of_what_failed(tmp_path):
    source, out = recorded(tmp_path / "run.mcap"), tmp_path / "out.mcap"
    out.write_bytes(b"mine")
    with pytest.raises(RosError, match=r"out\.mcap: there is such a file already"):
        export(source, out, KILTED)
    assert out.read_bytes() == b"mine"
    empty = recorded(tmp_path / "empty.mcap", count=0)
    with pytest.raises(RosError, match="it has no message with a counterpart in ROS"):
        export(empty, tmp_path / "other.mcap", KILTED)
    with pytest.raises(RosError, match="not a recording"):
        export(out, tmp_path / "other.mcap", KILTED)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty.mcap", "out.mcap", "run.mcap"]


def test_the_command_says_what_it_wrote(tmp_path):
    source = recorded(tmp_path / "run.mcap")
    done = CliRunner().invoke(app, ["export", str(source), str(tmp_path / "out.mcap")])
    assert done.exit_code == 0 and "/odom  5" in done.output.splitlines()
    done = CliRunner().invoke(app, ["export", str(source), str(tmp_path / "out.mcap")])
    assert done.exit_code == 1 and "navloom ros: " in done.output and len(done.output.splitlines()) == 1


def test_the_readme_lists_the_topics():
    text = (Path(__file__).parents[1] / "README.md").read_text("utf-8")
    for topic, what in TOPICS.items():
        assert f"| `{topic}` | {what} |" in text
