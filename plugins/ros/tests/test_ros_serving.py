"""`navloom ros serve`: goals from ROS tools, with a simulated robot, and the topics that it publishes."""

import sys
import threading
import time

import numpy as np
import pytest
from navloom import AvoiderDiagnostics, AvoiderStatus, Point2D, Pose2D, PoseEstimate, Twist2D
from navloom_ros.actions import ABORTED, CANCELED, SUCCEEDED
from navloom_ros.nav2.adapter import Nav2Handle, Nav2Navigator
from navloom_ros.node import Node
from navloom_ros.qos import LATCHED
from navloom_ros.serving.goals import THROUGH_POSES, TO_POSE
from navloom_ros.serving.outlets import Outlets
from navloom_ros.serving.poses import Poses
from navloom_ros.translating import Translated, Translator
from ros_golden import KILTED
from ros_network import until
from ros_served import ended, pose, served_network, served_robot  # noqa: F401


def test_a_goal_is_driven_told_of_and_reached(network, robot):
    heard = []
    sent = network.clients[TO_POSE].send({"pose": pose(2.0, 1.0, 0.5)}, heard.append)
    assert sent.is_accepted and until(lambda: robot.handles)
    assert robot.asked == [(2.0, 1.0, pytest.approx(0.5), [])]
    robot.handles[0].tell()
    assert until(lambda: heard)
    assert heard[0].distance_remaining == 1.25 and heard[0].number_of_recoveries == 1
    assert heard[0].current_pose.pose.position.x == 0.5 and heard[0].estimated_time_remaining.nanosec == 500_000_000
    robot.handles[0].end("succeeded")
    assert ended(sent).status == SUCCEEDED


def test_poses_to_pass_are_passed(network, robot):
    goals = {"header": {"frame_id": "map"}, "goals": [pose(1.0, 0.0), pose(2.0, 0.0), pose(3.0, 1.0, 1.0)]}
    heard = []
    sent = network.clients[THROUGH_POSES].send({"poses": goals}, heard.append)
    assert until(lambda: robot.asked) == [(3.0, 1.0, pytest.approx(1.0), [(1.0, 0.0), (2.0, 0.0)])]
    for x, y, left in ((0.2, 0.0, 3), (0.9, 0.1, 2), (1.2, 0.0, 2), (1.9, 0.0, 1), (3.0, 1.0, 1)):
        network.goals.pose = (x, y, 0.0)
        robot.handles[0].tell()
        assert until(lambda: heard).pop().number_of_poses_remaining == left
    robot.handles[0].end("succeeded")
    assert ended(sent).status == SUCCEEDED


def test_before_there_is_a_path_the_distance_is_the_straight_one(network, robot):
    heard = []
    network.clients[TO_POSE].send({"pose": pose(3.5, 4.0)}, heard.append)
    until(lambda: robot.handles)[0].tell(0.0)
    assert until(lambda: heard)[0].distance_remaining == 5.0  # from 0.5, 0


@pytest.mark.parametrize(("x", "why"), [(3.0, "no_path: a wall"), (101.0, "rejected: outside the map")])
def test_a_goal_that_is_not_reached_says_why(network, robot, x, why):
    sent = network.clients[TO_POSE].send({"pose": pose(x, 0.0)})
    if x < 100.0:
        until(lambda: robot.handles)[0].end("no_path", "a wall")
    done = ended(sent)
    assert (done.status, done.result.error_code, done.result.error_msg) == (ABORTED, 9000, why)
    assert network.said == [f"goal {x:g}, 0 m not reached: {why}"]


def test_a_goal_is_cancelled(network, robot):
    sent = network.clients[TO_POSE].send({"pose": pose(2.0, 0.0)})
    assert until(lambda: robot.handles) and sent.cancel()
    assert ended(sent).status == CANCELED and robot.handles[0].result.outcome == "cancelled"


def test_a_newer_goal_takes_over(network, robot):
    first = network.clients[TO_POSE].send({"pose": pose(2.0, 0.0)})
    assert until(lambda: len(robot.handles) == 1)
    second = network.clients[TO_POSE].send({"pose": pose(1.0, 0.0)})
    done = ended(first)
    assert done.status == ABORTED and done.result.error_msg == "pre-empted by a newer goal"
    assert done.result.error_code == 0
    assert until(lambda: len(robot.handles) == 2)
    robot.handles[1].end("succeeded")
    assert ended(second).status == SUCCEEDED


def turned(x, z, w):
    """A pose at (x, 0) with a quaternion of any length."""
    given = pose(x, 0.0)
    return given | {"pose": given["pose"] | {"orientation": {"z": z, "w": w}}}


def test_what_cannot_be_driven_is_rejected(network, robot):
    send = network.clients[TO_POSE].send
    assert not send({"pose": pose(1.0, 0.0, frame="odom")}).is_accepted
    assert not send({"pose": pose(1.0, 0.0, frame="odom")}).is_accepted  # says the same, so it is not shown again
    assert not send({"pose": pose(float("nan"), 0.0)}).is_accepted
    assert not network.clients[THROUGH_POSES].send({}).is_accepted
    assert not send({"pose": turned(1.0, z=0.0, w=0.0)}).is_accepted
    assert not network.clients[THROUGH_POSES].send({"poses": {"goals": [turned(1.0, 1.0, 1.0)]}}).is_accepted
    network.goals.robot = None
    assert not send({"pose": pose(1.0, 0.0)}).is_accepted
    assert robot.asked == []
    assert network.said == [
        "goal refused: it is in the frame 'odom': expected 'map'",
        "goal refused: its place nan, 0 m is not finite",
        "goal refused: it has no pose",
        "goal refused: its orientation is not a unit quaternion; for heading 0 give w = 1",
        "goal refused: the robot is down, or has no pose yet",
    ]


def test_the_goal_button_of_rviz_is_a_goal(network, robot):
    publisher = network.rviz.publisher("/goal_pose", "geometry_msgs/msg/PoseStamped")
    assert network.rviz.wait_for(lambda graph: graph.find("/goal_pose", ("MS",)), 5.0)
    assert until(lambda: publisher.publish(**pose(1.5, 0.5)) or robot.asked)[0][:2] == (1.5, 0.5)


def test_a_pose_estimate_is_taken_in_the_map_only(network):
    said = []
    poses = Poses(network.served, "map", (RuntimeError,), said.append)
    publisher = network.rviz.publisher("/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")

    def send(frame, variances=(0.0, 0.0, 0.0)):
        given, covariance = pose(1.0, 2.0, 0.5, frame), np.zeros(36)
        covariance[[0, 7, 35]] = variances
        publisher.publish(header=given["header"], pose={"pose": given["pose"], "covariance": covariance})

    until(lambda: send("odom") or poses._poses._queue)
    assert poses.take() is None and said[0] == "pose refused: it is in the frame 'odom': expected 'map'"
    assert until(lambda: send("map") or poses.take()) == (1.0, 2.0, pytest.approx(0.5), None)
    guess = until(lambda: send("map", (0.25, 0.09, 0.04)) or poses.take())
    assert guess.sigma == (pytest.approx(0.5), pytest.approx(0.2))


def test_the_service_of_amcl_has_the_robot_search_anywhere(network):
    said, asked = [], []
    poses = Poses(network.served, "map", (RuntimeError,), said.append)
    client = network.rviz.client("/reinitialize_global_localization", "std_srvs/srv/Empty")

    class Robot:
        def relocalise(self):
            asked.append("search")

    poses.robot = Robot()
    until(lambda: client.call(timeout=1.0) is not None)
    assert asked and not said


def test_a_nav2_robot_is_driven_like_one_of_ours(network, robot):
    with Nav2Navigator(network.router.endpoint, distribution="kilted") as navigator:
        handle = navigator.go(2.0, 1.0, 0.5)
        assert until(lambda: robot.handles)
        ours = threading.Thread(target=lambda: until(lambda: robot.handles[0].tell() or handle.feedback))
        ours.start()  # the first feedback may be sent before the client is discovered
        feedback = next(handle.updates(5.0))
        ours.join()
        assert (feedback.distance, feedback.time_left, feedback.recoveries) == (1.25, 2.5, 1)
        robot.handles[0].end("no_path", "a wall")
        result = handle.wait(5.0)
        assert (result.outcome, result.reason) == ("error", "aborted: no_path: a wall")
        assert (result.place.x, result.place.y) == (0.5, 0.0)  # its last place
        handle = navigator.go(3.0, 1.0, via=[(3.0, 0.0)])
        assert until(lambda: robot.asked[1:]) == [(3.0, 1.0, pytest.approx(np.pi / 2), [(3.0, 0.0)])]
        assert navigator.cancel() and handle.wait(5.0).outcome == "cancelled" and not navigator.cancel()
        network.goals.robot = None
        assert navigator.drive_to(1.0, 1.0).outcome == "rejected"


def test_only_what_was_asked_for_is_published(network):
    translator = Translator(KILTED)
    said_of = []
    outlets = Outlets(network.served, ["tf", "markers"], said_of.append)
    estimate = PoseEstimate(0, Pose2D(1.0, 2.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
    window = np.array([[0, 3], [9, 0]], np.uint8)
    what = AvoiderDiagnostics(window, 0.1, 0.0, 0.0, np.zeros(0), 0.0, np.array([[0.0, 1.0]]), 0.5, "a slot ahead")
    said = [("localizer", "pose", estimate), ("avoider", "status", AvoiderStatus("steering", what))]

    def publish():
        for role, port, message in said:
            for made in translator.translate(role, "one", port, message, 0):
                outlets.put(made)

    with Node("looks", router=network.router.endpoint, types=KILTED) as looks:
        transforms = looks.subscription("/tf", "tf2_msgs/msg/TFMessage", LATCHED)
        markers = looks.subscription("/avoider/markers", "visualization_msgs/msg/MarkerArray")
        received = until(lambda: publish() or (all(found := (transforms.take(0.05), markers.take(0.05))) and found))
        assert received[0].message.transforms[0].header.frame_id == "map"
        shown = {marker.ns: marker for marker in received[1].message.markers if marker.ns}
        assert set(shown) == {"costs", "slots", "chosen", "why"}
        assert shown["costs"].points[0].x == pytest.approx(0.05)  # the most certain cell first
        assert shown["slots"].points[0].x == pytest.approx(1.8) and shown["why"].text == "steering: a slot ahead"
        assert not looks.graph.find("/pose", ("MP",)) and said_of == []


def test_what_cannot_be_published_is_said_once(network):
    said = []
    outlets = Outlets(network.served, ["pose"], said.append)
    made = KILTED.new("geometry_msgs/msg/PoseWithCovarianceStamped")
    made.pose.covariance = np.zeros(35)
    for _ in range(3):
        outlets.put(Translated("/pose", made))
    (line,) = said
    assert line.startswith("/pose is not published: ") and line.endswith("pose.covariance has 35 elements; expected 36")


# --- a goal of Nav2, without a network -------------------------------------------------------------------------------


def feedback(distance=1.0):
    return KILTED.new("nav2_msgs/action/NavigateToPose_Feedback", distance_remaining=distance)


def test_a_goal_with_steady_feedback_times_out():
    handle = Nav2Handle(7, Point2D(1.0, 0.0))
    handle.hear(feedback())
    began, count = time.monotonic(), 0
    with pytest.raises(TimeoutError, match=r"goal 7 has not ended within 0\.1 s"):
        for _ in handle.updates(0.1):
            handle.hear(feedback())
            count += 1
            assert time.monotonic() - began < 2.0
    assert count > 2


def test_feedback_may_be_read_while_it_comes():
    handle, switch = Nav2Handle(1, Point2D(1.0, 0.0)), sys.getswitchinterval()
    failures = []

    def hear():
        try:
            for _ in range(20_000):
                handle.hear(feedback_now)
        except Exception as error:
            failures.append(error)

    feedback_now = feedback()
    sys.setswitchinterval(1e-6)
    try:
        hearing = threading.Thread(target=hear)
        hearing.start()
        with pytest.raises(TimeoutError):
            for _ in handle.updates(0.3):
                pass
        hearing.join()
    finally:
        sys.setswitchinterval(switch)
    assert failures == []


def test_only_the_newest_feedback_waits():
    handle = Nav2Handle(1, Point2D(1.0, 0.0))
    for number in range(100):
        handle.hear(feedback(float(number)))
    assert next(handle.updates(1.0)).distance == 36.0  # of 100, the last 64
