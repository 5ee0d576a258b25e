"""Encoding and decoding: compared with bytes that ROS 2 itself wrote, and with malformed bytes."""

import time

import numpy as np
import pytest
from fuzz_cdr import fuzz, warm_up
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_ros import message_types
from navloom_ros.errors import MalformedMessage, UnfitMessage, UnknownType
from navloom_ros.message_types import DISTRIBUTIONS, Types
from ros_golden import CDR, KILTED, WHEELS, masked

BASE, NAME, ARRAY = 1, 2, 3
RANGES = {f"{sign}int{bits}": (bits, sign) for bits in (8, 16, 32, 64) for sign in ("", "u")}
TESTED = sorted({one["type"] for one in WHEELS["messages"]} | set(CDR) | {"nav2_msgs/action/NavigateToPose_Goal"})
SPARE = 12
"""Most bytes after the end of a golden message."""


@pytest.mark.parametrize("name", CDR)
def test_a_golden_message_decodes_and_encodes_to_the_same_bytes(name):
    message = KILTED.decode(name, CDR[name])
    assert KILTED.encode(message) == masked(name, CDR[name])


@pytest.mark.parametrize("index", range(0, len(WHEELS["messages"]), 2), ids=lambda i: WHEELS["messages"][i]["type"])
def test_bytes_that_kilted_wrote_hold_the_values_that_it_was_given(index):
    for golden in WHEELS["messages"][index : index + 2]:
        data = bytes.fromhex(golden["cdr"])
        ours = KILTED.encode(KILTED.new(golden["type"], **golden["value"]))
        theirs = masked(golden["type"], data)
        assert theirs[: len(ours)] == ours
        assert len(theirs) - len(ours) <= SPARE and not any(theirs[len(ours) :])
        assert KILTED.encode(KILTED.decode(golden["type"], data)) == ours


def messages(name, depth=0):
    """A hypothesis strategy for messages of a type."""
    return st.fixed_dictionaries({field: values(descriptor, depth) for field, descriptor in fields_of(name)}).map(
        lambda drawn: KILTED.new(name, **drawn)
    )


def fields_of(name):
    return [(field, descriptor) for field, descriptor in KILTED.fields(name)]


def values(descriptor, depth):
    kind, rest = descriptor
    if kind == BASE:
        return scalars(rest[0])
    if kind == NAME:
        return messages(rest, depth + 1)
    inner, count = rest
    size = {"min_size": count, "max_size": count} if kind == ARRAY else {"max_size": 3}
    return st.lists(values(inner, depth), **size)


def scalars(base):
    if base in RANGES:
        bits, sign = RANGES[base]
        low = 0 if sign else -(2 ** (bits - 1))
        return st.integers(low, low + 2**bits - 1)
    if base == "string":
        return st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8)
    if base == "bool":
        return st.booleans()
    if base in ("byte", "char"):
        return st.integers(0, 255)
    return st.floats(width=32)


@pytest.mark.parametrize(
    "name",
    [
        "sensor_msgs/msg/JointState",
        "visualization_msgs/msg/Marker",
        "nav_msgs/srv/GetPlan_Response",
        "diagnostic_msgs/msg/DiagnosticArray",
        "rcl_interfaces/srv/SetParameters_Request",
        "nav2_msgs/action/NavigateThroughPoses_FeedbackMessage",
    ],
)
@given(data=st.data())
@settings(max_examples=25)
def test_a_message_survives_the_way_there_and_back(name, data):
    message = data.draw(messages(name))
    encoded = KILTED.encode(message)
    again = KILTED.decode(name, encoded)
    assert repr(KILTED.plain(again)) == repr(KILTED.plain(message))  # repr, where NaN equals NaN
    assert KILTED.encode(again) == encoded


@pytest.mark.parametrize("name", TESTED)
def test_every_cut_of_a_message_is_refused_or_harmless(name):
    data = KILTED.encode(KILTED.new(name))
    for length in range(len(data)):
        with pytest.raises(MalformedMessage, match=name.split("/")[-1]):
            KILTED.decode(name, data[:length])


def test_mutated_bytes_give_nothing_but_the_one_error():
    warm_up()
    report = fuzz(4000, seed=1)
    assert report.others == []
    assert report.decoded > 300 and report.refused > 2000
    assert report.slowest < 0.05, report


@pytest.mark.parametrize("count", [0xFFFFFFFF, 0x7FFFFFFF, 1 << 20])
def test_a_length_beyond_what_is_left_is_refused_before_anything_is_made(count):
    data = bytearray(KILTED.encode(KILTED.new("nav_msgs/msg/Path")))
    data[-4:] = count.to_bytes(4, "little")
    start = time.thread_time()
    with pytest.raises(MalformedMessage, match="Path: Invalid sequence length"):
        KILTED.decode("nav_msgs/msg/Path", bytes(data))
    assert time.thread_time() - start < 0.1


def test_a_message_larger_than_the_bound_is_refused():
    small = Types("jazzy", largest=100)
    data = KILTED.encode(KILTED.new("std_msgs/msg/String", data="x" * 200))
    with pytest.raises(MalformedMessage, match="209 bytes; at most 100 are decoded"):
        small.decode("std_msgs/msg/String", data)


def test_a_message_of_too_many_parts_is_refused(monkeypatch):
    monkeypatch.setattr(message_types, "MOST_PARTS", 10_000)
    empty, name = KILTED.encode(KILTED.new("geometry_msgs/msg/PolygonStamped"))[:-4], "geometry_msgs/msg/PolygonStamped"
    for points in (9_000, 12_000):  # each is one part; header, stamp and polygon are three
        data = empty + points.to_bytes(4, "little") + bytes(12 * points)
        if points < 10_000:
            assert len(KILTED.decode(name, data).polygon.points) == points
            continue
        with pytest.raises(MalformedMessage, match="more than 10000 messages within it"):
            KILTED.decode(name, data)


def test_a_large_cloud_is_read():
    cloud = KILTED.new("sensor_msgs/msg/PointCloud2", width=100_000, data=bytes(3_200_000))
    assert len(KILTED.decode("sensor_msgs/msg/PointCloud2", KILTED.encode(cloud)).data) == 3_200_000


def test_bytes_behind_the_end_are_refused_but_for_padding():
    data = KILTED.encode(KILTED.new("sensor_msgs/msg/LaserScan", ranges=[1.0, 2.0]))
    KILTED.decode("sensor_msgs/msg/LaserScan", data + bytes(3))
    with pytest.raises(MalformedMessage, match="4 bytes after its end"):
        KILTED.decode("sensor_msgs/msg/LaserScan", data + bytes(4))


def test_what_is_no_xcdr1_is_refused():
    data = KILTED.encode(KILTED.new("std_msgs/msg/Bool", data=True))
    with pytest.raises(MalformedMessage, match="begins with '00070000'"):
        KILTED.decode("std_msgs/msg/Bool", b"\0\7" + data[2:])


def test_big_endian_is_read_too():
    message = KILTED.decode("rosgraph_msgs/msg/Clock", bytes.fromhex("000000000000000500000007"))
    assert (message.clock.sec, message.clock.nanosec) == (5, 7)


def test_new_fills_what_is_not_given_and_takes_mappings_and_lists():
    pose = KILTED.new("geometry_msgs/msg/PoseStamped", header={"frame_id": "map"}, pose={"position": {"x": 2.0}})
    assert (pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w) == ("map", 2.0, 1.0)
    path = KILTED.new("nav_msgs/msg/Path", poses=[{"pose": {"position": {"y": 1.5}}}, pose])
    assert [one.pose.position.y for one in path.poses] == [1.5, 0.0]
    scan = KILTED.new("sensor_msgs/msg/LaserScan", ranges=[1, float("inf")])
    assert scan.ranges.dtype == np.float32 and len(scan.intensities) == 0


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        (
            "sensor_msgs/msg/LaserScan",
            {"ranges": np.zeros(3)},
            "LaserScan: ranges is an array of float64, shape .3,.; exp",
        ),
        ("sensor_msgs/msg/LaserScan", {"ranges": [1.0]}, "ranges is list; expected a numpy array of float32"),
        ("sensor_msgs/msg/LaserScan", {"header": 3}, "header is int; expected std_msgs/msg/Header"),
        ("sensor_msgs/msg/LaserScan", {"angle_min": "left"}, "LaserScan: required argument is not a float"),
        ("sensor_msgs/msg/LaserScan", {"ranges": np.zeros(6, "f4")[::2]}, "ranges is a strided view"),
        ("sensor_msgs/msg/Imu", {"angular_velocity_covariance": np.zeros(8)}, "has 8 elements; expected 9"),
        ("nav_msgs/msg/Path", {"poses": [3]}, r"poses\[0\] is int; expected geometry_msgs/msg/PoseStamped"),
        ("std_msgs/msg/UInt8", {"data": 256}, "UInt8: ubyte format requires"),
        ("std_msgs/msg/String", {"data": "\ud800"}, "String: .* surrogates not allowed"),
    ],
)
def test_values_that_do_not_fit_are_named(name, change, said):
    message = KILTED.new(name)
    for field, value in change.items():
        setattr(message, field, value)
    with pytest.raises(UnfitMessage, match=said):
        KILTED.encode(message)


def test_wrong_fields_and_types_are_named_with_what_there_is():
    with pytest.raises(UnfitMessage, match=r"Header.header has no field 'frame'; it has stamp, frame_id"):
        KILTED.new("geometry_msgs/msg/PoseStamped", header={"frame": "map"})
    with pytest.raises(UnfitMessage, match="ranges: not an array of float32"):
        KILTED.new("sensor_msgs/msg/LaserScan", ranges="near")
    with pytest.raises(UnknownType, match="'my_msgs/msg/Mine' is not known in kilted: give the folder"):
        KILTED.new("my_msgs/msg/Mine")
    with pytest.raises(UnknownType, match="'noetic': expected one of humble, jazzy, kilted, lyrical"):
        Types("noetic")


def test_arrays_of_a_decoded_message_are_read_only_and_aligned():
    scan = KILTED.decode("sensor_msgs/msg/LaserScan", CDR["sensor_msgs/msg/LaserScan"])
    odometry = KILTED.decode("nav_msgs/msg/Odometry", CDR["nav_msgs/msg/Odometry"])
    for values in (scan.ranges, odometry.pose.covariance):
        assert not values.flags.writeable and values.flags.aligned


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_types_that_differ_between_distributions_are_written_and_read(distribution):
    types = Types(distribution)
    names = [name for name in types.names if name.startswith("nav2_msgs") or name == "sensor_msgs/msg/Range"]
    assert len(names) > 15
    for name in names:
        data = types.encode(types.new(name))
        assert types.encode(types.decode(name, data)) == data, name
