"""The platform `ros2_base` with unusable, stale or missing messages: it stops the robot and gives the reason."""

import math
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
import ros_garbler
from navloom import Context, InputError, PlatformInput, Pose2D, RobotSpec, SensorSpec, Twist2D
from navloom_ros.base.adapter import Ros2Base
from navloom_ros.base.params import Ros2BaseParams
from navloom_ros.base.readings import Anchor, beams_of_laser
from navloom_ros.base.sources import CONTACT, ODOMETRY, STATIC, TF, Ranges, Robot
from navloom_ros.base.stamps import Delays
from navloom_ros.errors import MalformedMessage, RosError
from ros_heard import SECOND, Said, stamp
from test_ros2_base import planar, scan

SQUARE = np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]])
PERIOD_NS = SECOND // 20


class Cable(Said):
    """In place of `Link`: a network on which everything is well, except for what a test sets.

    Attributes:
        silent: By name in `Link`, why a topic has no message.
    """

    def __init__(self, types):
        super().__init__()
        self.types, self.silent = types, {}

    def problem(self):
        return ""

    def why_silent(self, name):
        return self.silent.get(name, "")

    def hear(self, name, message, sent_ns, arrived_ns):
        heard = SimpleNamespace(message=message, source_ns=sent_ns, gid=b"one", arrived_ns=arrived_ns)
        self.waiting.setdefault(name, []).append(heard)

    def send(self, vx, vy, wz, stamp_ns):
        pass


class Bench:
    """A platform without a network, and a clock that the test moves."""

    def __init__(self, monkeypatch, sensors=(), **params):
        given = {"base_timeout_s": 0.5, "distribution": "kilted"} | params
        spec = RobotSpec(SQUARE, 0.5, 0.05, 0.2, 0.5, 1.0, 1.0, 1.0)
        context = Context("base", 0.05, spec, np.random.default_rng, Pose2D(0.0, 0.0, 0.0), sensors)
        self.platform = Ros2Base(Ros2BaseParams.model_validate(given), context)
        self.cable = self.platform._robot.reads = self.platform._link = Cable(self.platform._link.types)
        self.now_ns = 100 * SECOND
        monkeypatch.setattr("navloom_ros.base.adapter.monotonic_ns", lambda: self.now_ns)
        self.moved()

    def say(self, name, kind, **values):
        self.cable.say(name, kind, self.now_ns, self.now_ns, **values)

    def moved(self, **values):
        if self.platform.params.odometry == "topic":
            self.say(ODOMETRY, "nav_msgs/msg/Odometry", **({"header": {"stamp": stamp(self.now_ns)}} | values))

    def ticks(self, seconds, *each):
        """Step for some seconds with odometry, and with what `each` says; the last reason, or the last output."""
        out = None
        for _ in range(round(seconds * SECOND / PERIOD_NS)):
            self.now_ns += PERIOD_NS
            self.moved()
            for act in each:
                act()
            out = self.tick()
        return out

    def tick(self):
        try:
            return self.platform.advance(PlatformInput(Twist2D(0.0, 0.0, 0.0), None, self.now_ns - 100 * SECOND))
        except RosError as error:
            return str(error)


# --- contact ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "field", "why"),
    [
        ("std_msgs/msg/Bool", "pressed", "std_msgs/msg/Bool has no field 'pressed': expected one of data"),
        ("std_msgs/msg/Bool", "data.pressed", "no field 'pressed': it is no message"),
        ("sensor_msgs/msg/Range", "header", "header of sensor_msgs/msg/Range is a std_msgs/msg/Header"),
        ("sensor_msgs/msg/Imu", "orientation_covariance", "is an array of fixed length: expected a bool"),
    ],
)
def test_a_contact_field_that_says_nothing_is_refused_with_the_config(monkeypatch, kind, field, why):
    with pytest.raises(InputError, match=why):
        Bench(monkeypatch, contact_topic="/bumper", contact_type=kind, contact_field=field)


def test_a_nested_contact_field_is_read(monkeypatch):
    bench = Bench(
        monkeypatch, contact_topic="/hit", contact_type="sensor_msgs/msg/Range", contact_field="header.frame_id"
    )
    assert not bench.ticks(0.1, lambda: bench.say(CONTACT, "sensor_msgs/msg/Range")).contact.touching
    bench.say(CONTACT, "sensor_msgs/msg/Range", header={"frame_id": "front"})
    assert bench.tick().contact.touching


def test_a_bumper_that_never_came_or_falls_silent_stops_the_robot(monkeypatch):
    bench = Bench(monkeypatch, contact_topic="/bumper")
    assert bench.tick() == "/bumper has no message yet: if it sends changes only, set contact_timeout = 0"
    bench.cable.silent[CONTACT] = "no node publishes it"
    assert bench.tick() == "/bumper has no message yet: no node publishes it"
    bumper = lambda: bench.say(CONTACT, "std_msgs/msg/Bool")  # noqa: E731
    assert bench.ticks(0.5, bumper).contact.touching is False
    assert bench.ticks(0.9).contact.touching is False
    assert bench.ticks(0.2) == "/bumper has been silent for 1.1 s: no node publishes it"
    assert bench.ticks(0.05, bumper).contact.touching is False


def test_a_bumper_that_sends_changes_only_may_be_silent_but_not_gone(monkeypatch):
    bench = Bench(monkeypatch, contact_topic="/bumper", contact_timeout=0.0)
    assert bench.ticks(3.0).contact.touching is False
    bench.say(CONTACT, "std_msgs/msg/Bool", data=True)
    assert bench.ticks(3.0).contact.touching is True
    bench.cable.silent[CONTACT] = "no node publishes it"
    assert bench.tick() == "/bumper has been silent for 3.0 s: no node publishes it"


def test_a_short_contact_between_two_ticks_is_felt(monkeypatch):
    bench = Bench(monkeypatch, contact_topic="/bumper")
    for state in (True, False):
        bench.say(CONTACT, "std_msgs/msg/Bool", data=state)
    assert bench.tick().contact.touching and not bench.tick().contact.touching
    bench.say(CONTACT, "std_msgs/msg/Bool", data=True)
    bench.now_ns += SECOND
    assert bench.tick() == "/odom has been silent for 1.00 s"
    bench.say(CONTACT, "std_msgs/msg/Bool", data=False)
    assert bench.ticks(0.05).contact.touching  # it was not reported before


# --- range sensors ----------------------------------------------------------------------------------------------------


LIMITS = {"range_min": 0.1, "range_max": 9.0, "angle_increment": 0.1, "header": {"frame_id": "laser"}}
LEANING = {"x": math.sin(0.25), "w": math.cos(0.25)}


@pytest.fixture
def lasered(monkeypatch):
    return Bench(monkeypatch, (SensorSpec("laser", "laser_scan", {}),))


def mounted(bench, frame, **transform):
    one = {"header": {"frame_id": "base_link"}, "child_frame_id": frame, "transform": transform}
    bench.say(STATIC, "tf2_msgs/msg/TFMessage", transforms=[one])


@pytest.mark.parametrize(
    ("turned", "values", "why"),
    [
        (LEANING, {"ranges": [1.0]}, "a laser that is tilted by 29°: expected at most 10°"),
        ({}, {"ranges": [1.0], "range_max": math.nan}, "a laser scan with the limits 0.1 to nan m"),
        ({}, {"ranges": [0.0, 0.0]}, "set short_is_nothing = true"),
        ({}, {"ranges": [1.0, 1.0], "angle_increment": 0.0}, "a laser scan of 2 beams, 0 rad apart"),
        (None, {"ranges": [1.0]}, "no transform from its frame 'laser' to 'base_link': publish it, give the sensor a"),
        (None, {"ranges": [1.0], "header": {}}, "no transform from its frame '' to 'base_link'"),
    ],
)
def test_a_laser_that_cannot_be_used_is_a_reason(lasered, turned, values, why):
    if turned is not None:
        mounted(lasered, "laser", rotation=turned)
    told = lasered.ticks(1.2, lambda: lasered.say("scan", "sensor_msgs/msg/LaserScan", **(LIMITS | values)))
    assert told.startswith("sensor laser: /scan: ") and why in told
    mounted(lasered, "laser")
    good = LIMITS | {"ranges": [1.0]}
    assert "laser" in lasered.ticks(0.05, lambda: lasered.say("scan", "sensor_msgs/msg/LaserScan", **good)).scans


@pytest.mark.parametrize("name", ros_garbler.SCANS)
def test_a_spoiled_scan_does_not_displace_a_good_one(lasered, name):
    mounted(lasered, "laser")
    kind, types = "sensor_msgs/msg/LaserScan", lasered.cable.types
    limits = {"range_min": 0.1, "range_max": 8.0, "angle_min": -3.0, "angle_max": 2.98, "angle_increment": 0.02}
    for _ in range(30):
        lasered.now_ns += PERIOD_NS
        lasered.moved()
        sent_ns = lasered.now_ns + 7200 * SECOND  # the robot's clock is far ahead
        header = {"frame_id": "laser", "stamp": stamp(sent_ns)}
        good = types.new(kind, header=header, ranges=[1.0] * 300, **limits)
        lasered.cable.hear("scan", good, sent_ns, lasered.now_ns)
        with suppress(MalformedMessage):
            spoiled = types.decode(kind, ros_garbler.SCANS[name](good))
            lasered.cable.hear("scan", spoiled, sent_ns, lasered.now_ns)
        scan = lasered.tick().scans["laser"]
        assert scan.stamp_ns == lasered.now_ns - 100 * SECOND
        assert scan.ranges.tolist() == [1.0] * 300 and scan.bearings[0] == pytest.approx(-3.0)


def test_a_laser_that_never_came_is_a_reason_and_one_that_falls_silent_is_left_to_the_gate(lasered):
    lasered.cable.silent["scan"] = "no node publishes it"
    assert not lasered.ticks(0.9).scans
    assert lasered.ticks(0.3) == "sensor laser: /scan: no node publishes it"
    mounted(lasered, "laser")
    lasered.say("scan", "sensor_msgs/msg/LaserScan", **LIMITS, ranges=[1.0])
    assert lasered.tick().scans
    assert lasered.ticks(5.0).scans == {}


def test_invalid_scans_between_good_ones_do_not_stop_the_robot(lasered):
    mounted(lasered, "laser")

    def both():
        lasered.say("scan", "sensor_msgs/msg/LaserScan", **LIMITS, ranges=[1.0])
        lasered.say("scan", "sensor_msgs/msg/LaserScan", **(LIMITS | {"header": {"frame_id": "none"}}), ranges=[1.0])

    assert "laser" in lasered.ticks(3.0, both).scans


def test_the_reason_is_that_of_the_first_sonar_though_the_last_one_is_well(monkeypatch):
    bench = Bench(monkeypatch, (SensorSpec("ring", "ranges", {"topics": ["/a", "/b"]}),))
    mounted(bench, "b")
    limits = {"min_range": 0.1, "max_range": 3.0, "range": 1.0}

    def both():
        for frame in "ab":
            bench.say(f"/{frame}", "sensor_msgs/msg/Range", header={"frame_id": frame}, **limits)

    assert bench.ticks(1.2, both).startswith("sensor ring: /a: no transform from its frame 'a'")
    mounted(bench, "a")
    assert bench.ticks(0.05, both).scans["ring"].ranges.tolist() == [1.0, 1.0]


def test_an_invalid_range_does_not_replace_a_good_one():
    said = Said()
    robot = Robot(said, "base", "odom", Anchor(False, 0.5, 1.0))
    ring = Ranges(("/a", "/b"), (planar(0, 0, 0), planar(0, 0, 1.0)), SECOND // 2, False)
    for topic, length in (("/a", 1.0), ("/b", 2.0), ("/a", math.nan)):
        said.say(topic, "sensor_msgs/msg/Range", 100 * SECOND, SECOND, min_range=0.1, max_range=3.0, range=length)
    assert ring.read(robot, SECOND)[0].ranges.tolist() == [1.0, 2.0]
    assert ring.feeds[0].why == "a range that is NaN"


def test_a_scan_that_was_measured_before_the_last_one_is_left_out(lasered):
    mounted(lasered, "laser")

    def scan(seconds_old, ranges):
        header = {"frame_id": "laser", "stamp": stamp(lasered.now_ns - round(seconds_old * SECOND))}
        lasered.say("scan", "sensor_msgs/msg/LaserScan", **(LIMITS | {"header": header}), ranges=ranges)

    scan(0.0, [1.0])
    scan(0.4, [2.0])
    assert lasered.ticks(0.05).scans["laser"].ranges.tolist() == [1.0]
    assert lasered.ticks(0.05, lambda: scan(0.4, [2.0])).scans == {}
    assert lasered.ticks(0.05, lambda: scan(0.0, [3.0])).scans["laser"].ranges.tolist() == [3.0]


def test_a_range_that_was_measured_before_the_last_one_is_left_out():
    said = Said()
    robot = Robot(said, "base", "odom", Anchor(False, 0.5, 1.0))
    ring = Ranges(("/a",), (planar(0, 0, 0),), SECOND, False)
    for measured_ns, length in ((100 * SECOND, 1.0), (100 * SECOND - SECOND // 2, 2.0)):
        given = {"header": {"stamp": stamp(measured_ns)}, "min_range": 0.1, "max_range": 3.0, "range": length}
        said.say("/a", "sensor_msgs/msg/Range", 100 * SECOND, 100 * SECOND, **given)
    assert ring.read(robot, 100 * SECOND)[0].ranges.tolist() == [1.0]


def test_an_object_too_close_to_measure_is_never_free_space():
    beams = beams_of_laser(scan([0.0, -math.inf, 2.0]), planar(0, 0, 0), True)
    assert beams.ranges.tolist() == [math.inf, pytest.approx(0.1), 2.0]


# --- odometry ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("child", "there", "why"),
    [
        ("laser", {"translation": {"x": 0.1}}, "0.10 m from 'base_link', turned by 0° and tilted by 0°"),
        ("imu", {"rotation": {"z": 1.0, "w": 0.0}}, "0.00 m from 'base_link', turned by 180° and tilted by 0°"),
        ("laser", {"rotation": {"x": 1.0, "w": 0.0}}, "0.00 m from 'base_link', turned by 0° and tilted by 180°"),
        ("tb1/base_link", None, "which /tf does not connect to 'base_link'"),
    ],
)
def test_odometry_of_another_frame_than_the_base_is_a_reason(monkeypatch, child, there, why):
    bench = Bench(monkeypatch)
    bench.cable.waiting.clear()
    if there is not None:
        mounted(bench, child, **there)
    bench.moved(child_frame_id=child)
    told = bench.tick()
    assert told.startswith(f"/odom has no message yet: odometry of the frame '{child}', ") and why in told
    assert told.endswith(": correct child_frame_id where it is published, or set base_frame")
    assert "base_frame" not in str(bench.ticks(0.05))


@pytest.mark.parametrize("child", ["", "base_link", "/base_link", "base_footprint"])
def test_odometry_of_the_base_is_taken_by_any_of_its_names(monkeypatch, child):
    bench = Bench(monkeypatch)
    bench.cable.waiting.clear()
    mounted(bench, "base_footprint", translation={"z": -0.05})
    bench.moved(child_frame_id=child, pose={"pose": {"position": {"x": 0.1}}})
    assert bench.tick().odometry.pose.x == 0.1


def test_odometry_far_beyond_any_room_does_not_move_the_pose(monkeypatch):
    bench = Bench(monkeypatch)
    for x in (0.0, 1e18, 0.1):
        bench.moved(pose={"pose": {"position": {"x": x}}})
    assert bench.tick().odometry.pose == Pose2D(0.1, 0.0, 0.0)
    bench.now_ns += SECOND
    bench.moved(pose={"pose": {"position": {"x": 1e18}}})
    assert bench.tick() == "/odom has been silent for 1.00 s: odometry at 1e+18, 0 m: expected at most 1e+06 m"


def test_the_reason_of_old_invalid_odometry_is_forgotten(monkeypatch):
    bench = Bench(monkeypatch)
    bench.moved(pose={"pose": {"position": {"x": math.nan}}})
    bench.ticks(0.1)
    bench.now_ns += SECOND
    assert bench.tick() == "/odom has been silent for 1.00 s"


def test_a_jump_of_tf_is_a_restart_of_the_odometry_and_no_fault(monkeypatch):
    bench = Bench(monkeypatch, odometry="tf")

    def at(x):
        header = {"frame_id": "odom", "stamp": stamp(bench.now_ns)}
        one = {"header": header, "child_frame_id": "base_link", "transform": {"translation": {"x": x}}}
        bench.say(TF, "tf2_msgs/msg/TFMessage", transforms=[one])

    bench.ticks(0.5, lambda: at(3.0))
    assert bench.ticks(0.05, lambda: at(0.0)).odometry.pose.x == pytest.approx(3.0)
    bench.ticks(0.05, lambda: at(0.01))
    assert bench.ticks(0.05, lambda: at(0.02)).odometry.pose.x == pytest.approx(3.01)


def test_a_base_that_repeats_its_last_odometry_does_not_stay_fresh(monkeypatch):
    bench = Bench(monkeypatch)
    old = {"header": {"stamp": stamp(bench.now_ns)}}
    for _ in range(60):
        bench.now_ns += PERIOD_NS
        bench.moved(**old)
        told = bench.tick()
    assert told == "/odom has messages, but the newest was measured 3.00 s ago: the robot or its link is slow"


def test_delays_that_grow_beyond_a_second_are_no_set_clock():
    delays = Delays()
    for number in range(100):  # 50 Hz, and each message takes 20 ms longer than the one before
        sent_ns = number * SECOND // 50
        assert delays.measured_ns(sent_ns, sent_ns, sent_ns + number * SECOND // 50) == sent_ns


def test_data_that_grow_old_before_they_are_sent_are_old():
    delays = Delays()
    for number in range(100):  # a node that lags by 20 ms more with each message
        stamp_ns, sent_ns = 1 + number * SECOND // 50, 1 + number * SECOND // 25
        assert delays.measured_ns(stamp_ns, sent_ns, sent_ns) == stamp_ns


def test_two_publishers_of_odometry_are_noticed_though_they_agree():
    anchor = Anchor(False, 0.5, 1.0)
    for number in range(5):
        anchor.place((0.01 * number, 0.0, 0.0), b"one" if number % 2 else b"two", number * PERIOD_NS)
    assert anchor.is_unsteady(4 * PERIOD_NS)
