"""The loop of `navloom ros serve`: with a stand-in for the robot, and, slow, with a live one and a peer."""

import math
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from live_rig import EMPTY, up
from navloom import GateStatus, MapUpdate, Navigator, NavloomError, OccupancyGrid, Pose2D, PoseEstimate, Twist2D
from navloom.messages import StopReason
from navloom_ros.actions import SUCCEEDED, ActionClient
from navloom_ros.node import Node
from navloom_ros.qos import LATCHED
from navloom_ros.serving import adapter
from ros_golden import KILTED
from ros_network import Router, until
from ros_peer import Dora, arrow, environment

sys.path.insert(0, str(Path(__file__).parent / "peers"))
from describe import describe

TO_POSE = "nav2_msgs/action/NavigateToPose"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
PEERS = environment()


def pose_at(x, y, heading, frame="map"):
    turned = {"z": math.sin(heading / 2), "w": math.cos(heading / 2)}
    return {"header": {"frame_id": frame}, "pose": {"pose": {"position": {"x": x, "y": y}, "orientation": turned}}}


ROOM = MapUpdate(0, OccupancyGrid(np.zeros((80, 100), np.int8), 0.1, Pose2D(-4.0, -4.0, 0.0)), np.empty((0, 4)), ())
"""10 x 8 m."""


class StandIn:
    """In place of `Navigator`: a robot at the origin of a room."""

    def __init__(self, *_):
        platform = SimpleNamespace(role="platform", instance="main")
        self.client = SimpleNamespace(
            keys=SimpleNamespace(prefix="lab/r1"), has_nodes=lambda: True, describe=lambda: [platform]
        )
        self.places, self.driven, self.is_joined, self.limits = [], None, False, []

    def __enter__(self):
        self.is_joined = True
        return self

    def __exit__(self, *_):
        self.is_joined = False

    def listen(self, streams):
        estimate = PoseEstimate(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
        told = [("localizer", "main", "pose", estimate, 0), ("mapper", "main", "map", ROOM, 0)]
        return SimpleNamespace(take=lambda wait: told + [("gate", "main", "status", one, 0) for one in self.stopped])

    stopped, platform, takes_pose, cleared = (), {}, True, 0

    def get_parameters(self, role, instance):
        return self.platform

    def place(self, x, y, heading, sigma=None):
        if not self.takes_pose:
            raise NavloomError("localizer main takes no pose")
        self.places.append((x, y, heading))

    def go(self, x, y, heading=None, via=()):
        self.driven = Driven(self, x)
        return self.driven

    def footprint(self):
        return np.array([(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)])

    def limit_speed(self, speed, is_percentage):
        self.limits.append((speed, is_percentage))

    def clear_map(self):
        self.cleared += 1


class Driven:
    """A goal that a `StandIn` drives to; it ends when it is cancelled, and its feedback takes no time."""

    def __init__(self, robot, x):
        self.robot, self.x, self.result = robot, x, None
        self.cancelled_while_joined = None

    def updates(self, timeout):
        time.sleep(0.001)
        raise TimeoutError

    def cancel(self):
        self.cancelled_while_joined = self.robot.is_joined
        self.result = SimpleNamespace(outcome="cancelled", reason="by the operator", code="by_operator")


@contextmanager
def served(network, take, publish=("pose",), namespace="", remap=None):
    """What `serve` says; it runs on a thread."""
    said, ending = [], threading.Event()
    given = adapter.Serving(None, None, None, False, network.endpoint, 0, namespace, KILTED, publish, take, remap or {})
    thread = threading.Thread(target=adapter.serve, args=(given, ending.is_set, said.append))
    thread.start()
    try:
        yield said
    finally:
        ending.set()
        thread.join(10.0)
        assert not thread.is_alive()


@pytest.fixture(scope="module")
def network():
    with Router() as router:
        yield router


def test_a_pose_estimate_of_rviz_is_set_on_the_robot(network, monkeypatch):
    robot = StandIn()
    monkeypatch.setattr(adapter, "Navigator", lambda *_: robot)
    with served(network, ["pose"]) as said, Node("rviz", router=network.endpoint, types=KILTED) as rviz:
        estimates = rviz.publisher("initialpose", POSE)
        places = until(lambda: estimates.publish(**pose_at(1.0, 2.0, 0.5)) or robot.places)
        assert places[0] == (1.0, 2.0, pytest.approx(0.5))
        robot.takes_pose = False
        estimates.publish(**pose_at(3.0, 0.0, 0.0))
        assert until(lambda: "pose refused: localizer main takes no pose" in said)
        robot.takes_pose = True
        estimates.publish(**pose_at(6.1, 0.0, 0.0))
        outside = "pose refused: (6.1, 0) is outside the map, which covers 10 x 8 m from (-4, -4)"
        assert until(lambda: outside in said) and not [place for place in robot.places if place[0] > 6.0]
        assert said[0] == f"robot lab/r1 is served in domain 0 of {network.endpoint}"


@pytest.mark.parametrize("is_click", [True, False])
def test_the_goal_is_cancelled_while_the_robot_can_still_be_reached(network, monkeypatch, is_click):
    robot = StandIn()
    monkeypatch.setattr(adapter, "Navigator", lambda *_: robot)
    with served(network, ["goals"]) as said, Node("rviz", router=network.endpoint, types=KILTED) as rviz:
        there = {"header": {"frame_id": "map"}, "pose": {"position": {"x": 1.0}}}
        if is_click:
            clicks = rviz.publisher("goal_pose", "geometry_msgs/msg/PoseStamped")
            until(lambda: clicks.publish(**there) or robot.driven)
        else:
            client = ActionClient(rviz, "navigate_to_pose", TO_POSE)
            assert client.wait(5.0) and until(lambda: client.send({"pose": there}).is_accepted)
        assert until(lambda: robot.driven)
    assert robot.driven.cancelled_while_joined
    assert not any("not reached" in line for line in said)


def test_a_namespace_moves_every_topic_and_action(network, monkeypatch):
    monkeypatch.setattr(adapter, "Navigator", StandIn)
    with (
        served(network, ["goals", "pose"], ["pose", "tf", "diagnostics"], "/tb1", {"tf": "/tf"}),
        Node("rviz", router=network.endpoint, types=KILTED) as rviz,
    ):
        assert rviz.wait_for(lambda graph: graph.find("/tf", ("MP",)), 5.0)
        ours = {entity.name for entity in rviz.graph.entities if entity.node == "navloom_server" and entity.name}
        assert {name for name in ours if not name.startswith("/tb1/")} == {"/tf"}
        assert {"/tb1/goal_pose", "/tb1/initialpose", "/tb1/pose", "/tb1/navigate_to_pose/_action/status"} <= ours


def test_nav2s_nodes_are_active_when_the_robot_can_be_driven(network, monkeypatch):
    robot = StandIn()
    monkeypatch.setattr(adapter, "Navigator", lambda *_: robot)
    with Node("script", router=network.endpoint, types=KILTED) as script:
        navigator, localizer = (
            script.client(f"{name}/get_state", "lifecycle_msgs/srv/GetState") for name in ("bt_navigator", "amcl")
        )
        poses = script.subscription("amcl_pose", POSE, LATCHED)
        with served(network, ["goals"]):
            assert script.wait_for(lambda graph: graph.find("/amcl/get_state", ("SS",)), 5.0)
            assert until(lambda: navigator.call().current_state.label == "active")
            assert localizer.call().current_state.id == 3 and poses.take(5.0).message.header.frame_id == "map"
            robot.stopped = [GateStatus("none", "", True, True, StopReason("operator"), ())]
            assert until(lambda: navigator.call().current_state.label == "inactive")
            assert localizer.call().current_state.label == "active"


def test_a_simulated_robot_is_stamped_with_the_time_of_its_simulator(network, monkeypatch):
    robot = StandIn()
    robot.platform = {"simulated": True}
    monkeypatch.setattr(adapter, "Navigator", lambda *_: robot)
    with Node("rviz", router=network.endpoint, types=KILTED) as rviz:
        poses = rviz.subscription("amcl_pose", POSE, LATCHED)
        clock = rviz.publisher("/clock", "rosgraph_msgs/msg/Clock")
        with served(network, ["goals"]):
            assert rviz.wait_for(lambda graph: graph.find("/clock", ("MS",)), 5.0) and poses.take(0.3) is None
            received = until(lambda: clock.publish(clock={"sec": 12, "nanosec": 5}) or poses.take(0.05))
            assert (received.message.header.stamp.sec, received.message.header.stamp.nanosec) == (12, 5)
            statuses = rviz.subscription("navigate_to_pose/_action/status", "action_msgs/msg/GoalStatusArray", LATCHED)
            client = ActionClient(rviz, "navigate_to_pose", TO_POSE)
            there = {"header": {"frame_id": "map"}, "pose": {"position": {"x": 1.0}}}
            assert client.wait(5.0) and until(lambda: client.send({"pose": there}).is_accepted)
            accepted = until(lambda: (got := statuses.take(1.0)) and got.message.status_list)
            assert accepted[0].goal_info.stamp.sec == 12


def test_the_calls_of_nav2s_simple_commander_drive_three_goals(network, monkeypatch):
    robot = StandIn()
    monkeypatch.setattr(adapter, "Navigator", lambda *_: robot)
    with (
        served(network, ["goals", "pose"]),
        Node("basic_navigator", router=network.endpoint, types=KILTED) as commander,
    ):
        poses = commander.subscription("amcl_pose", POSE, LATCHED)
        initial = commander.publisher("initialpose", POSE)
        client = ActionClient(commander, "navigate_to_pose", TO_POSE)
        for name in ("amcl", "bt_navigator"):  # waitUntilNav2Active
            state = commander.client(f"{name}/get_state", "lifecycle_msgs/srv/GetState")
            assert commander.wait_for(lambda graph, name=name: graph.find(f"/{name}/get_state", ("SS",)), 5.0)
            assert until(lambda state=state: state.call().current_state.label == "active")
            assert until(lambda: initial.publish(**pose_at(1.0, 2.0, 0.5)) or (poses.take(0.1) and robot.places))
        costmap = "global_costmap/clear_entirely_global_costmap"
        commander.client(costmap, "nav2_msgs/srv/ClearEntireCostmap").call()  # clearGlobalCostmap
        for x in (1.0, 2.0, 3.0):  # goToPose, isTaskComplete, getResult
            assert client.wait(5.0)
            sent = client.send({"pose": {"header": {"frame_id": "map"}, "pose": {"position": {"x": x}}}})
            assert sent.is_accepted and until(lambda x=x: robot.driven and robot.driven.x == x)
            robot.driven.result = SimpleNamespace(outcome="succeeded", reason="", code="reached")
            assert sent.result(5.0).result(6.0).status == SUCCEEDED
        assert robot.cleared == 1


def test_without_take_nothing_is_taken_from_the_network(network, monkeypatch):
    monkeypatch.setattr(adapter, "Navigator", StandIn)
    with served(network, []), Node("rviz", router=network.endpoint, types=KILTED) as rviz:
        assert rviz.wait_for(lambda graph: graph.find("/amcl_pose", ("MP",)), 5.0)
        ours = [entity for entity in rviz.graph.entities if entity.node == "navloom_server"]
        assert {entity.name for entity in ours if entity.kind in ("MS", "SS", "SC")} == set()
        assert {entity.name for entity in ours if entity.kind == "MP"} == {"/pose", "/amcl_pose"}


def test_a_robot_that_is_down_is_an_error_in_the_diagnostics(network, monkeypatch):
    def down(*_):
        raise NavloomError("no robot is up")

    monkeypatch.setattr(adapter, "Navigator", down)
    with Node("looks", router=network.endpoint, types=KILTED) as looks:
        told = looks.subscription("diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        with served(network, [], ["diagnostics"]) as said:
            (status,) = told.take(5.0).message.status
            assert (status.level, status.message) == (2, "no robot: no robot is up")
            assert said == ["no robot is up; retrying until it is up"]


# --- a live robot and dora-rs as its operator ------------------------------------------------------------------------


NAVLOOM = str(Path(sys.executable).with_name("navloom"))


@contextmanager
def command(*arguments):
    """A navloom command as a process, ended by Ctrl-C."""
    process = subprocess.Popen([NAVLOOM, *arguments], stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=20.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def said_by(process, text):
    """Wait until a command has printed this text."""
    assert any(text in line for line in process.stderr), text


@pytest.mark.slow
@pytest.mark.skipif(PEERS is None, reason="needs NAVLOOM_ROS_PEERS: a venv with the group ros-peers")
def test_a_peer_drives_a_live_robot_and_sets_its_pose(network, tmp_path, monkeypatch):
    (tmp_path / "robot.toml").write_text(EMPTY)
    interfaces = Path(__file__).parents[1] / "src" / "navloom_ros" / "interfaces"
    describe(KILTED, [interfaces / "kilted", interfaces / "since_kilted"], tmp_path / "described")
    serve = ["ros", "serve", "--router", network.endpoint, "--distro", "kilted", "--take", "goals,pose"]
    with up(str(tmp_path / "robot.toml")) as host:
        host.wait_for("every node is there")
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", host.environment["NAVLOOM_RUNTIME_DIR"])
        with command(*serve) as serving, Navigator() as robot:
            said_by(serving, "is served in domain 0")
            peer = Dora(PEERS, network.endpoint, tmp_path / "described")
            peer.action_client("/navigate_to_pose", "nav2_msgs/NavigateToPose")
            goal = arrow(
                KILTED, f"{TO_POSE}_Goal", pose={"header": {"frame_id": "map"}, "pose": {"position": {"x": 1.5}}}
            )
            goal_id = until(lambda: peer.send_goal("/navigate_to_pose", goal), 20.0)
            ended = until(lambda: peer.take_result("/navigate_to_pose", goal_id, 30.0), 60.0)
            assert (ended[0], ended[1]["error_msg"]) == ("succeeded", "")
            poses = robot.listen(["localizer/pose"])
            assert poses.take(5.0)[-1].message.pose.x == pytest.approx(1.5, abs=0.3)
            peer.publisher("/initialpose", "geometry_msgs/PoseWithCovarianceStamped", {})
            estimate = arrow(KILTED, POSE, **pose_at(-3.0, 2.0, 0.5))
            for _ in range(50):  # until the publisher is discovered
                peer.publish("/initialpose", estimate)
                pose = poses.take(0.5)[-1].message.pose
                if pose.x < 0.0:
                    break
            assert (pose.x, pose.y, pose.heading) == pytest.approx((-3.0, 2.0, 0.5), abs=0.05)
            peer.close()
