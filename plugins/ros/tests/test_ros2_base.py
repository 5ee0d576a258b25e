"""The platform `ros2_base`: with a simulated robot on a network over loopback, and its parts without a network."""

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from navloom import Context, InputError, PlatformInput, Pose2D, RobotSpec, SensorSpec, Twist2D
from navloom_ros.bag_conversion import laser_scan, range_reading
from navloom_ros.base import sources as base_sources
from navloom_ros.base.adapter import Ros2Base
from navloom_ros.base.frames import Frames, heading_of, planar
from navloom_ros.base.params import Ros2BaseParams
from navloom_ros.base.readings import Anchor, Motion, beams_of_laser, beams_of_ranges, check_range, motion_of
from navloom_ros.base.stamps import Delays
from navloom_ros.errors import RosError, Unusable
from navloom_ros.frames import Mount
from navloom_ros.node import Node
from pydantic import ValidationError
from ros_golden import KILTED
from ros_heard import SECOND, Said, stamp
from ros_network import Router, until
from ros_robot import MOUNT, ROOM, Robot

PERIOD = 0.05
SQUARE = np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]])
SENSORS = (
    SensorSpec("laser", "laser_scan", {}),
    SensorSpec("sonars", "ranges", {"topics": ["sonar"]}),
)


class Driven:
    """Steps a platform in ticks of the wall clock, as the live runner does."""

    def __init__(self, router, **params):
        given = {"router": router, "distribution": "kilted", "base_timeout_s": 0.5, "contact_topic": "bumper"} | params
        spec = RobotSpec(SQUARE, 0.5, 0.05, 0.2, 0.5, 1.0, 1.0, 1.0)
        context = Context("base", PERIOD, spec, np.random.default_rng, Pose2D(0.0, 0.0, 0.0), SENSORS)
        self.platform = Ros2Base(Ros2BaseParams.model_validate(given), context)
        self._start_ns = time.monotonic_ns()
        self.why = ""

    def tick(self, vx=0.0, wz=0.0):
        """One tick: the output of the platform, or None if it raises; `why` has the reason."""
        time.sleep(PERIOD)
        time_ns = time.monotonic_ns() - self._start_ns
        try:
            return self.platform.advance(PlatformInput(Twist2D(vx, 0.0, wz), None, time_ns)), time_ns
        except RosError as error:
            self.why = str(error)
            return None

    def begin(self, longest=20.0):
        """Step until the platform can drive."""
        return until(self.tick, longest)


@pytest.fixture(scope="module")
def network():
    with Router() as router:
        yield router


@pytest.fixture(scope="module")
def robot(network):
    with Robot(KILTED, network.endpoint) as one:
        yield one


@pytest.fixture(scope="module")
def driven(network, robot):
    one = Driven(network.endpoint)
    assert one.begin(), one.why
    yield one
    one.platform.close()


def speeds(robot, since):
    return [speed for at, speed, _ in list(robot.heard) if at >= since]


def test_it_drives_and_hears_the_robot(driven, robot):
    before = robot.pose[0]
    scans, sonars = [], []
    for _ in range(20):
        out, time_ns = driven.tick(0.3)
        scans += [(scan, time_ns) for name, scan in out.scans.items() if name == "laser"]
        sonars += [scan for name, scan in out.scans.items() if name == "sonars"]
        assert 0 <= time_ns - out.odometry.stamp_ns < 0.25 * SECOND  # though the robot's clock is 123 s ahead
        assert out.contact.touching is False and out.truth is None
    assert robot.pose[0] - before > 0.15 and out.odometry.twist.vx == pytest.approx(0.3)
    assert out.odometry.pose.x == pytest.approx(robot.pose[0], abs=0.1)
    scan, _ = scans[-1]
    ahead = scan.ranges[np.argmin(np.abs(scan.bearings))]
    assert ahead == pytest.approx(ROOM - robot.pose[0] - MOUNT, abs=0.1)
    assert scan.origins[0].tolist() == pytest.approx([MOUNT, 0.0])
    assert math.isinf(sonars[-1].ranges[0]) and sonars[-1].half_angles[0] == pytest.approx(0.15)
    driven.tick()


def test_it_receives_the_topics_of_its_config_and_nothing_else(driven, network):
    with Node("looks", router=network.endpoint, types=KILTED) as looks:
        looks.settle()
        ours = [entity for entity in looks.graph.entities if entity.node.startswith("navloom")]
    assert {entity.name for entity in ours if entity.kind == "MS"} == {
        "/odom",
        "/tf",
        "/tf_static",
        "/scan",
        "/sonar",
        "/bumper",
    }
    assert {entity.name for entity in ours if entity.kind == "MP"} == {"/cmd_vel"}
    assert not [entity for entity in ours if entity.kind in ("SS", "SC")]


def test_a_namespace_moves_every_topic_and_the_remedy_is_named_where_it_lacks():
    with Router() as router, Robot(KILTED, router.endpoint, namespace="/tb1") as robot:
        lost = Driven(router.endpoint)
        text = "no node subscribes to /cmd_vel; /tb1/cmd_vel exists: set namespace or remap"
        assert until(lambda: lost.tick() is None and lost.why == text, 20.0), lost.why
        lost.platform.close()
        one = Driven(router.endpoint, namespace="/tb1")
        assert one.begin(), one.why
        assert until(lambda: one.tick(0.2) and robot.heard[-1:] and robot.heard[-1][1] == 0.2, 5.0)
        one.platform.close()


def test_a_name_that_ros_does_not_allow_is_refused_with_the_config():
    with pytest.raises(InputError, match="name '/tb-1'"):
        Driven("tcp/127.0.0.1:1", namespace="tb-1")


def test_the_guardian_stops_the_base_of_a_platform_that_freezes(driven, robot):
    took: list[float] = []
    while not took or (took[-1] >= 0.15 + 0.05 and len(took) < 3):  # the robot reads commands every 20 ms
        for _ in range(4):
            driven.tick(0.1)
        frozen = time.monotonic()
        stopped = until(lambda since=frozen: [at for at, v, _ in list(robot.heard) if at > since and v == 0.0], 2.0)
        took.append(stopped[0] - frozen)
        assert driven.begin()  # it can drive again
    assert took[-1] < 0.15 + 0.05, took  # a busy host delays one of three freezes, a slow guardian all
    assert until(lambda: driven.tick(0.1) and speeds(robot, time.monotonic() - 0.1)[-1:] == [0.1], 2.0)
    driven.tick()


def test_a_robot_that_falls_silent_is_a_reason(driven, robot):
    robot.is_silent = True
    until(lambda: driven.tick() is None, 2.0)
    assert driven.why.startswith("/odom has been silent for 0.")
    robot.is_silent = False
    assert driven.begin()


def test_a_contact_is_felt(driven, robot):
    robot.touches = True
    assert until(lambda: (told := driven.tick()) and told[0].contact.touching, 2.0)
    robot.touches = False
    assert until(lambda: (told := driven.tick()) and not told[0].contact.touching, 2.0)


def test_a_guardian_that_dies_is_replaced(driven):
    driven.platform._link._guard._process.kill()
    assert until(lambda: driven.tick() is None, 2.0)
    assert "guardian" in driven.why
    assert driven.begin()


def test_the_robots_router_may_restart(driven, network, robot):
    network.stop()
    assert until(lambda: driven.tick() is None, 5.0)
    assert driven.why == f"the link to the router {network.endpoint} is down"
    network.start()
    assert driven.begin(), driven.why
    assert until(lambda: driven.tick(0.1) and speeds(robot, time.monotonic() - 0.1)[-1:] == [0.1], 3.0)
    driven.tick()


def test_a_base_that_takes_the_other_type_is_named(network, robot):
    other = Driven(network.endpoint, stamped=True, node="other")
    assert until(lambda: other.tick() or "stamped" in other.why, 15.0)
    assert other.why == (
        "/base subscribes to /cmd_vel as geometry_msgs/msg/Twist, not geometry_msgs/msg/TwistStamped; "
        "set stamped = false"
    )
    other.platform.close()


@pytest.mark.slow
def test_a_simulated_robot_is_driven_by_its_clock():
    with Router() as router, Robot(KILTED, router.endpoint, stamped=True, simulated=True) as robot:
        driven = Driven(router.endpoint, stamped=True, simulated=True)
        assert driven.begin(), driven.why
        out, time_ns = [told for _ in range(10) if (told := driven.tick(0.3))][-1]
        assert 0 <= time_ns - out.odometry.stamp_ns < 0.25 * SECOND and robot.pose[0] > 0.05
        robot.is_silent = True
        until(lambda: driven.tick(0.3) is None and "/clock" in driven.why, 3.0)
        assert driven.why == "/clock has stopped: the simulator is paused or has ended"
        driven.platform.close()


def test_a_base_without_a_command_timeout_is_refused():
    with pytest.raises(ValidationError, match=r"base_timeout_s\n.*required"):
        Ros2BaseParams.model_validate({})
    with pytest.raises(ValidationError, match="without_base_timeout = true"):
        Ros2BaseParams.model_validate({"base_timeout_s": 0.0})
    assert Ros2BaseParams.model_validate({"base_timeout_s": 0.0, "without_base_timeout": True})


def test_a_tick_longer_than_the_bases_patience_is_refused():
    with pytest.raises(InputError, match=r"less than two ticks of 0\.05 s"):
        Driven("tcp/127.0.0.1:1", base_timeout_s=0.09)


def test_a_platform_that_is_only_made_touches_no_robot():
    made = Driven("tcp/127.0.0.1:1")
    assert made.platform._link._guard is None and made.platform._link._joining.node is None


# --- parts without a network ------------------------------------------------------------------------------------------


def quaternion(roll=0.0, yaw=0.0):
    if roll:
        return SimpleNamespace(x=math.sin(roll / 2), y=0.0, z=0.0, w=math.cos(roll / 2))
    return SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))


def transforms(*rows):
    return SimpleNamespace(
        transforms=[
            SimpleNamespace(
                header=SimpleNamespace(frame_id=parent),
                child_frame_id=child,
                transform=SimpleNamespace(translation=SimpleNamespace(x=x, y=y, z=0.0), rotation=turned),
            )
            for parent, child, x, y, turned in rows
        ]
    )


def test_frames_are_found_up_and_down_the_tree():
    frames = Frames()
    frames.add(
        transforms(("odom", "/base", 5.0, 0.0, quaternion()), ("base", "mast", 1.0, 0.0, quaternion(yaw=math.pi / 2)))
    )
    frames.add(transforms(("mast", "laser", 0.5, 0.0, quaternion())))
    found = frames.find("base", "laser")
    assert found[:2, 3].tolist() == pytest.approx([1.0, 0.5]) and heading_of(found) == pytest.approx(math.pi / 2)
    assert frames.find("laser", "odom") is not None and frames.find("base", "elsewhere") is None
    frames.add(transforms(("laser", "odom", 0.0, 0.0, quaternion())))  # a cycle is not followed forever
    assert frames.find("base", "elsewhere") is None


def scan(ranges, **given):
    values = {"range_min": 0.1, "range_max": 10.0, "angle_min": -0.5, "angle_increment": 0.5, "angle_max": 0.0,
              "time_increment": 0.01}  # fmt: skip
    return SimpleNamespace(ranges=np.array(ranges, np.float32), **(values | given))


SIGNALLING = np.array([0x7F800001, 0x40000000], np.uint32).view(np.float32)
"""A signalling NaN, which numpy warns of when it converts it, and 2."""


@pytest.mark.filterwarnings("error")
def test_a_signalling_nan_is_no_measurement_and_no_warning():
    assert beams_of_laser(scan(SIGNALLING), planar(0, 0, 0), False).ranges.tolist() == [2.0]
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0))
    said = laser_scan(scan(SIGNALLING, header=header), Mount(np.eye(3), np.zeros(3)))
    assert said.ranges.tolist() == [2.0]


def test_only_beams_that_say_something_are_kept():
    beams = beams_of_laser(scan([math.nan, 2.0, 0.0, math.inf, -math.inf, 11.0]), planar(0.2, 0.0, 0.0), False)
    assert beams.ranges.tolist() == [2.0, math.inf, pytest.approx(0.1), math.inf]
    assert beams.bearings.tolist() == pytest.approx([0.0, 1.0, 1.5, 2.0])
    assert beams.time_offsets.tolist() == pytest.approx([0.01, 0.03, 0.04, 0.05])
    assert len(beams_of_laser(scan([0.0, 2.0]), planar(0, 0, 0), True).ranges) == 2


def test_a_laser_may_hang_upside_down_but_not_lean():
    frames = Frames()
    frames.add(
        transforms(("base", "laser", 0.0, 0.0, quaternion(roll=math.pi)), ("base", "lean", 0, 0, quaternion(roll=0.5)))
    )
    beams = beams_of_laser(scan([1.0, 2.0, 3.0]), frames.find("base", "laser"), False)
    assert beams.bearings.tolist() == pytest.approx([0.5, 0.0, -0.5])
    with pytest.raises(Unusable, match="tilted by 29°"):
        beams_of_laser(scan([1.0]), frames.find("base", "lean"), False)


@pytest.mark.parametrize("wrong", [{"range_min": math.nan}, {"range_max": 0.0}, {"angle_increment": 1e9}])
def test_a_scan_that_means_nothing_is_unusable(wrong):
    with pytest.raises(Unusable):
        beams_of_laser(scan([1.0], **wrong), planar(0, 0, 0), False)


@pytest.mark.parametrize("angle_max", [1.0, 0.5, 1.5, 1.0 - math.tau])
def test_the_last_beam_of_a_scan_is_at_its_last_angle_or_next_to_it(angle_max):
    assert len(beams_of_laser(scan([1.0] * 4, angle_max=angle_max), planar(0, 0, 0), False).ranges) == 4


def test_a_scan_with_too_few_or_too_many_ranges_for_its_angles_is_unusable():
    for count in (8, 24):
        with pytest.raises(
            Unusable, match=rf"of {count} beams, 0\.1000 rad apart, which do not fit its angles 0\.000 to"
        ):
            beams_of_laser(
                scan([1.0] * count, angle_min=0.0, angle_max=1.5, angle_increment=0.1), planar(0, 0, 0), False
            )


STAMPED = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0))


@pytest.mark.parametrize(("reading", "expected"), [(9.99, 9.99), (10.0, math.inf), (10.01, math.inf)])
def test_a_laser_reading_of_range_max_is_no_echo_live_and_in_a_bag(reading, expected):
    given = scan([reading], header=STAMPED)
    live, imported = beams_of_laser(given, planar(0, 0, 0), False), laser_scan(given, Mount(np.eye(3), np.zeros(3)))
    assert live.ranges.tolist() == imported.ranges.tolist() == [pytest.approx(expected)]


def sonar(reading, **given):
    values = {"min_range": 0.1, "max_range": 3.0, "field_of_view": 0.2, "header": STAMPED}
    return SimpleNamespace(range=reading, **(values | given))


@pytest.mark.parametrize(
    ("reading", "expected"),
    [(0.0, 0.1), (0.05, 0.1), (-math.inf, 0.1), (0.1, 0.1), (2.99, 2.99), (3.0, math.inf), (3.5, math.inf)],
)
def test_a_sonar_reads_the_same_live_and_in_a_bag(reading, expected):
    live = beams_of_ranges([sonar(reading)], [planar(0.0, 0.0, 0.0)], False)
    imported = range_reading(sonar(reading), Mount(np.eye(3), np.zeros(3)))
    assert live.ranges.tolist() == imported.ranges.tolist() == [expected]


@pytest.mark.parametrize(("reading", "expected"), [(0.0, math.inf), (-math.inf, 0.1), (0.1, 0.1)])
def test_a_sonar_that_reports_0_for_nothing_can_be_read_so(reading, expected):
    """-inf is an object that is too close (REP 117), whatever 0 means."""
    assert beams_of_ranges([sonar(reading)], [planar(0, 0, 0)], True).ranges.tolist() == [expected]


def test_a_sensor_of_fixed_distance_says_that_something_is_there():
    """REP 117: min_range equals max_range, -inf is a detection, +inf is none."""
    fixed = [sonar(reading, min_range=0.8, max_range=0.8) for reading in (-math.inf, math.inf)]
    beams = beams_of_ranges(fixed, [planar(0, 0, 0)] * 2, False)
    assert (beams.ranges < beams.range_max).tolist() == [True, False]


@pytest.mark.parametrize("wrong", [{"reading": math.nan}, {"reading": 1.0, "min_range": 0.0, "max_range": 0.0}])
def test_a_range_that_means_nothing_is_unusable(wrong):
    with pytest.raises(Unusable):
        check_range(sonar(**wrong))


def test_odometry_that_is_no_number_is_unusable():
    message = KILTED.new("nav_msgs/msg/Odometry", twist={"twist": {"linear": {"x": math.nan}}})
    with pytest.raises(Unusable):
        motion_of(message)
    with pytest.raises(Unusable, match=r"of 1e\+30 m/s and 0 rad/s, which the robot cannot drive"):
        Anchor(False, 0.5, 1.0).check(Motion((0.0, 0.0, 0.0), (1e30, 0.0, 0.0)))


def test_a_clock_that_is_ahead_is_never_compared_with_ours():
    delays = Delays()
    hour = 3600 * SECOND
    assert delays.measured_ns(hour - 20_000_000, hour, SECOND) == SECOND - 20_000_000  # 20 ms old when sent
    late = delays.measured_ns(hour + SECOND, hour + SECOND, 2 * SECOND + 300_000_000)
    assert late == 2 * SECOND  # it took 300 ms longer than the first
    assert delays.measured_ns(5, hour + 2 * SECOND, 3 * SECOND) == 3 * SECOND
    assert delays.measured_ns(0, 2 * hour, 4 * SECOND) == 4 * SECOND  # the robot's clock was set
    assert delays.measured_ns(0, hour, 5 * SECOND) == 5 * SECOND


def test_odometry_that_begins_again_goes_on_where_it_was():
    anchor = Anchor(False, 0.5, 1.0)
    assert anchor.place((2.0, 1.0, math.pi / 2), b"one", 0) == (2.0, 1.0, math.pi / 2)
    assert anchor.place((0.0, 0.0, 0.0), b"two", SECOND) == pytest.approx((2.0, 1.0, math.pi / 2))
    assert anchor.place((0.5, 0.0, 0.0), b"two", 2 * SECOND) == pytest.approx((2.0, 1.5, math.pi / 2))
    assert not anchor.is_unsteady(2 * SECOND)
    for number in range(4):
        anchor.place((5.0 * (number % 2), 0.0, 0.0), b"two" if number % 2 else b"one", 2 * SECOND + number)
    assert anchor.is_unsteady(3 * SECOND) and not anchor.is_unsteady(5 * SECOND)
    first = Anchor(True, 0.5, 1.0)
    assert first.place((2.0, 1.0, 1.0), b"one", 0) == pytest.approx((0.0, 0.0, 0.0))


# --- state of the robot, without a network ---------------------------------------------------------------------------


def test_odometry_may_be_that_of_tf():
    said = Said()
    robot = base_sources.Robot(said, "base", "odom", Anchor(False, 0.5, 1.0))
    for number, x in enumerate((0.0, 0.02, 0.04)):
        at_ns = (1 + number) * SECOND // 10
        header = {"frame_id": "odom", "stamp": stamp(at_ns)}
        moved = {"header": header, "child_frame_id": "base", "transform": {"translation": {"x": x}}}
        said.say(base_sources.TF, "tf2_msgs/msg/TFMessage", at_ns, at_ns, transforms=[moved])
    robot.listen(from_tf=True)
    assert robot.pose == pytest.approx((0.04, 0.0, 0.0)) and robot.twist == pytest.approx((0.2, 0.0, 0.0))
    assert robot.measured_ns == 3 * SECOND // 10


def test_stamps_of_a_simulator_are_those_of_its_clock():
    said = Said()
    robot = base_sources.Robot(said, "base", "odom", Anchor(False, 0.5, 1.0), is_simulated=True)
    assert robot.clock_problem(SECOND) == "/clock has no message yet, and simulated = true"
    said.say(base_sources.CLOCK, "rosgraph_msgs/msg/Clock", 0, 50 * SECOND, clock=stamp(7 * SECOND))
    values = {"header": {"frame_id": "odom", "stamp": stamp(7 * SECOND - 40_000_000)}}
    said.say(base_sources.ODOMETRY, "nav_msgs/msg/Odometry", 0, 50 * SECOND, **values)
    robot.listen(from_tf=False)
    assert robot.measured_ns == 50 * SECOND - 40_000_000  # 40 ms old by the simulator's clock
    assert robot.clock_ns(51 * SECOND) == 8 * SECOND and robot.clock_problem(50 * SECOND) == ""
    assert robot.clock_problem(51 * SECOND) == "/clock has stopped: the simulator is paused or has ended"


def test_a_laser_that_starts_late_or_is_nowhere_is_left_out():
    said = Said()
    robot = base_sources.Robot(said, "base", "odom", Anchor(False, 0.5, 1.0))
    laser = base_sources.Laser("/scan", None, False)
    assert laser.read(robot, SECOND) is None and laser.feeds[0].why == ""
    values = {"header": {"frame_id": "laser"}, "range_min": 0.1, "range_max": 9.0, "angle_increment": 0.1}
    said.say("/scan", "sensor_msgs/msg/LaserScan", 0, SECOND, ranges=[1.0, 2.0], **values)
    assert laser.read(robot, SECOND) is None and "no transform from its frame 'laser' to 'base'" in laser.feeds[0].why
    moved = {"header": {"frame_id": "base"}, "child_frame_id": "laser", "transform": {"translation": {"x": 0.3}}}
    said.say(base_sources.STATIC, "tf2_msgs/msg/TFMessage", 0, SECOND, transforms=[moved])
    robot.listen(from_tf=False)
    said.say("/scan", "sensor_msgs/msg/LaserScan", 0, SECOND, ranges=[1.0, 2.0], **values)
    beams, at_ns = laser.read(robot, SECOND)
    assert beams.origins.tolist() == [[0.3, 0.0], [0.3, 0.0]] and at_ns == SECOND and laser.feeds[0].why == ""


def test_a_ring_is_silent_where_one_of_its_sonars_is():
    said = Said()
    robot = base_sources.Robot(said, "base", "odom", Anchor(False, 0.5, 1.0))
    ring = base_sources.Ranges(("/a", "/b"), (planar(0.1, 0, 0), planar(0, 0.1, 1.0)), SECOND // 2, False)
    for topic in ("/a", "/b"):
        said.say(topic, "sensor_msgs/msg/Range", 100 * SECOND, SECOND, min_range=0.1, max_range=3.0, range=1.0)
    assert ring.read(robot, SECOND)[0].bearings.tolist() == [0.0, 1.0]
    said.say("/a", "sensor_msgs/msg/Range", 101 * SECOND, 2 * SECOND, min_range=0.1, max_range=3.0, range=1.0)
    assert ring.read(robot, 2 * SECOND) is None
