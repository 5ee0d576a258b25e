"""`navloom ros serve`: what of Nav2's interface goes beyond goals, with a simulated robot."""

import numpy as np
import pytest
from navloom import GateStatus, OccupancyGrid, Pose2D
from navloom.messages import StopReason
from navloom_ros.actions import ABORTED, CANCELED, SUCCEEDED, ActionClient
from navloom_ros.serving.costmaps import inflated, local_costmap, monitor_state
from navloom_ros.serving.goals import TO_POSE, WAYPOINTS
from navloom_ros.serving.speed_limits import SpeedLimits
from ros_golden import KILTED
from ros_network import until
from ros_served import BEHAVIOURS, ended, pose, served_network, served_robot  # noqa: F401


@pytest.mark.parametrize(
    ("code", "expected"),
    [("goal_occupied", 206), ("outside_map", 204), ("no_path", 208), ("no_progress", 105), ("not_tracking", 9002),
     ("overdue", 9003), ("contact", 106), ("node_failed", 9000), ("", 9000)],
)  # fmt: skip
def test_the_error_code_says_what_failed(network, robot, code, expected):
    sent = network.clients[TO_POSE].send({"pose": pose(3.0, 0.0)})
    until(lambda: robot.handles)[0].end("stuck", "here", code)
    assert ended(sent).result.error_code == expected


@pytest.mark.parametrize(("y", "expected"), [(0.05, 9000), (4.05, 206), (4.15, 204)])
def test_the_map_says_why_a_goal_was_refused(network, robot, y, expected):
    cells = np.zeros((1, 41), np.int8)
    cells[0, 40] = 100
    # Rotated by 90°: the cells lie along y, of which the last one, from 4 to 4.1 m, is occupied.
    network.goals.map = OccupancyGrid(cells, 0.1, Pose2D(101.05, 0.0, np.pi / 2))
    assert ended(network.clients[TO_POSE].send({"pose": pose(101.0, y)})).result.error_code == expected
    network.goals.map = None


def test_a_path_is_computed_without_driving(network, robot):
    client = ActionClient(network.rviz, "compute_path_to_pose", "nav2_msgs/action/ComputePathToPose")
    assert client.wait(5.0)
    done = ended(client.send({"goal": pose(2.0, 1.0, 0.5)}))
    assert done.status == SUCCEEDED and robot.asked == []
    assert robot.planned == [((0.5, 0.0, 0.0), (2.0, 1.0, pytest.approx(0.5)))]
    assert [(one.pose.position.x, one.pose.position.y) for one in done.result.path.poses] == [
        (0.5, 0),
        (0.5, 1),
        (2, 1),
    ]
    assert done.result.path.poses[0].pose.orientation.z == pytest.approx(np.sqrt(0.5))  # along the path: 90°
    done = ended(client.send({"goal": pose(6.0, 1.0), "start": pose(1.0, 1.0), "use_start": True}))
    assert (done.status, done.result.error_code, done.result.error_msg) == (ABORTED, 206, "the goal is occupied")
    assert robot.planned[1][0] == (1.0, 1.0, 0.0)
    assert not client.send({"goal": pose(1.0, 1.0, frame="odom")}).is_accepted
    unset = pose(1.0, 1.0)
    unset["pose"]["orientation"] = {"z": 0.0, "w": 0.0}
    done = ended(client.send({"goal": pose(2.0, 1.0), "start": unset, "use_start": True}))
    assert done.status == ABORTED and done.result.error_msg.startswith("the start: its orientation is not a unit")
    assert len(robot.planned) == 2


def test_a_path_is_valid_where_the_map_is_free(network, robot):
    client = network.rviz.client("is_path_valid", "nav2_msgs/srv/IsPathValid")
    network.goals.map = OccupancyGrid(np.array([[0, 100, -1, 0]], np.int8), 1.0, Pose2D(0.0, 0.0, 0.0))
    network.goals.footprint = np.array([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])

    def judged(*xs, **given):
        answer = client.call({"path": {"poses": [pose(x, 0.5) for x in xs]}} | given)
        return answer.is_valid, answer.invalid_pose_indices.tolist()

    assert judged(0.5, 2.5, 3.5) == (True, [])
    assert judged(0.5, 1.5, 4.5) == (False, [1, 2])
    assert judged(0.5, 2.5, consider_unknown_as_obstacle=True) == (False, [1])
    network.goals.map = None


@pytest.mark.parametrize(("y", "heading", "expected"), [(0.5, 0.0, True), (0.5, np.pi / 2, False), (0.35, 0.0, False)])
def test_a_path_is_valid_where_the_footprint_fits(network, robot, y, heading, expected):
    """0.8 x 0.4 m in a corridor of 0.5 m, between walls below 0.25 m and above 0.75 m."""
    cells = np.full((20, 60), 100, np.int8)
    cells[5:15] = 0
    network.goals.map = OccupancyGrid(cells, 0.05, Pose2D(0.0, 0.0, 0.0))
    network.goals.footprint = np.array([(-0.4, -0.2), (0.4, -0.2), (0.4, 0.2), (-0.4, 0.2)])
    client = network.rviz.client("is_path_valid", "nav2_msgs/srv/IsPathValid")
    answer = client.call({"path": {"poses": [pose(1.0, 0.5), pose(2.0, y, heading)]}})
    assert (answer.is_valid, answer.invalid_pose_indices.tolist()) == (expected, [] if expected else [1])
    network.goals.map = None


def test_a_speed_limit_reaches_the_robot_and_its_restarted_gate(network, robot):
    limits = SpeedLimits(network.served, (RuntimeError,), network.said.append)
    publisher = network.rviz.publisher("speed_limit", "nav2_msgs/msg/SpeedLimit")

    def asked(speed, percentage):
        publisher.publish(speed_limit=speed, percentage=percentage)
        limits.take(robot, repeats=False)
        return robot.limits[-1:] == [(speed, percentage)]

    assert until(lambda: asked(50.0, True))
    count = len(robot.limits)
    limits.take(robot, repeats=True)
    assert robot.limits[count:] and set(robot.limits) == {(50.0, True)}
    assert until(lambda: asked(-1.0, False) or network.said) == ["speed limit not set: expected 0 or more"]


def test_a_costmap_is_inflated_by_the_inscribed_radius():
    """A cell's centre may be as far as the radius from the edge of an obstacle's cell, not nearer; 3.5 - 1 is 2.5."""
    cells = np.zeros((1, 9), np.int8)
    cells[0, 0], cells[0, 2] = 100, -1
    assert inflated(cells, 2.5).tolist() == [[100, 99, -1, 0, 0, 0, 0, 0, 0]]
    assert inflated(cells, 2.6).tolist() == [[100, 99, -1, 99, 0, 0, 0, 0, 0]]
    assert inflated(np.array([[0], [0], [100]], np.int8), 1.0).tolist() == [[0], [99], [100]]


def test_clearing_a_costmap_clears_the_map(network, robot):
    clear = network.rviz.client("global_costmap/clear_entirely_global_costmap", "nav2_msgs/srv/ClearEntireCostmap")
    clear.call()
    assert robot.cleared == 1


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        ("Spin", {"target_yaw": -1.5}, (0.5, -1.5)),
        ("Spin", {"target_yaw": 7.0}, (0.5, 7.0)),
        ("BackUp", {"target": {"x": 0.3}, "speed": 0.1}, (0.2, 0.0)),
        ("DriveOnHeading", {"target": {"x": 0.3}, "speed": 0.1}, (0.8, 0.0)),
    ],
)
def test_a_behaviour_drives_its_distance(network, robot, name, given, expected):
    client = ActionClient(network.rviz, BEHAVIOURS[name], f"nav2_msgs/action/{name}")
    assert client.wait(5.0)
    done = ended(client.send(given))
    assert (done.status, done.result.error_code) == (SUCCEEDED, 0)
    x, _, heading = network.goals.pose
    assert (x, heading) == pytest.approx(expected, abs=0.02)
    assert robot.sent[-1] == (0.0, 0.0) and max(abs(vx) for vx, _ in robot.sent) < 0.101


@pytest.mark.parametrize(
    ("given", "code", "why"),
    [
        ({"target": {"x": 0.3}, "speed": -0.1}, 724, "expected finite ones of the same sign"),
        ({"target": {"x": 2.0}, "speed": 0.5}, 723, "the gate holds the robot: an obstacle"),
        ({"target": {"x": 2.0}, "speed": 0.01, "time_allowance": {"nanosec": 10**8}}, 721, "of 2.00 after 0.1 s"),
    ],
    ids=["signs", "obstacle", "time"],
)
def test_a_behaviour_that_fails_says_why(network, robot, monkeypatch, given, code, why):
    monkeypatch.setattr("navloom_ros.serving.behaviours.HELD", 0.2)
    client = ActionClient(network.rviz, "drive_on_heading", "nav2_msgs/action/DriveOnHeading")
    assert client.wait(5.0)
    done = ended(client.send(given))
    assert (done.status, done.result.error_code) == (ABORTED, code) and why in done.result.error_msg


def test_a_behaviour_ends_before_the_robot_is_left(network, robot):
    client = ActionClient(network.rviz, "backup", "nav2_msgs/action/BackUp")
    assert client.wait(5.0)
    sent = client.send({"target": {"x": 50.0}, "speed": 0.1})
    assert until(lambda: robot.sent)
    network.goals.detach()
    assert robot.sent[-1] == (0.0, 0.0) and ended(sent).status == ABORTED


def test_a_behaviour_is_rejected_while_the_robot_drives_to_a_goal(network, robot):
    client = ActionClient(network.rviz, "spin", "nav2_msgs/action/Spin")
    network.clients[TO_POSE].send({"pose": pose(3.0, 0.0)})
    assert client.wait(5.0) and until(lambda: robot.handles)
    assert not client.send({"target_yaw": 1.0}).is_accepted


def test_waypoints_are_driven_to_one_after_the_other_and_those_missed_are_listed(network, robot):
    heard = []
    sent = network.clients[WAYPOINTS].send({"poses": [pose(1.0, 0.0), pose(2.0, 0.0), pose(3.0, 0.0)]}, heard.append)
    for number, outcome in enumerate(["succeeded", "stuck", "succeeded"]):
        assert until(lambda number=number: len(robot.handles) > number)
        robot.handles[number].end(outcome, "a wall", "blocked")
    done = ended(sent)
    assert [x for x, *_ in robot.asked] == [1.0, 2.0, 3.0]
    (missed,) = done.result.missed_waypoints
    assert (done.status, missed.waypoint_index, missed.error_code) == (SUCCEEDED, 1, 105)
    assert [one.current_waypoint for one in heard] == [0, 1, 2]


def test_waypoints_are_cancelled_as_a_whole(network, robot):
    sent = network.clients[WAYPOINTS].send({"poses": [pose(1.0, 0.0), pose(2.0, 0.0)]})
    assert until(lambda: robot.handles) and sent.cancel()
    assert ended(sent).status == CANCELED and len(robot.handles) == 1


def test_the_local_costmap_is_the_map_round_the_robot():
    cells = np.arange(100 * 100, dtype=np.int64).reshape(100, 100) % 100
    grid = OccupancyGrid(cells.astype(np.int8), 0.5, Pose2D(-10.0, -20.0, 0.0))
    made = local_costmap(KILTED, grid, (-8.9, 5.1), {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "map"}).message
    # 6 m along y; along x, the map begins 1.1 m left of the robot.
    assert (made.info.width, made.info.height) == (8, 12)
    assert (made.info.origin.position.x, made.info.origin.position.y) == (-10.0, 2.0)
    assert made.data[:3].tolist() == cells[44, :3].tolist()


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        (GateStatus("controller", "main", False, False, None, ()), (0, "")),
        (GateStatus("controller", "main", False, False, None, (), 0.4, "obstacle"), (2, "obstacle")),
        (GateStatus("none", "", True, False, StopReason("obstacle"), (), 0.0, "obstacle"), (1, "obstacle")),
        (GateStatus("none", "", True, False, StopReason("no_trajectory"), ()), (0, "")),
    ],
)
def test_the_state_of_the_collision_monitor_is_that_of_the_gate(status, expected):
    made = monitor_state(KILTED, status).message
    assert (made.action_type, made.polygon_name) == expected
