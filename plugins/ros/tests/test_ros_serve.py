"""The loop of `navloom ros serve`: with a stand-in for the robot, and, slow, with a live one and a peer."""

import math
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from live_rig import EMPTY, up
from navloom import Navigator, NavloomError, Pose2D, PoseEstimate, Twist2D
from navloom_ros.node import Node
from navloom_ros.serving import adapter
from ros_golden import KILTED
from ros_network import Router, until
from ros_peer import Dora, arrow, environment

sys.path.insert(0, str(Path(__file__).parent / "peers"))
from describe import describe

POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
PEERS = environment()


def pose_at(x, y, heading, frame="map"):
    turned = {"z": math.sin(heading / 2), "w": math.cos(heading / 2)}
    return {"header": {"frame_id": frame}, "pose": {"pose": {"position": {"x": x, "y": y}, "orientation": turned}}}


class StandIn:
    """In place of `Navigator`: a robot at the origin. Places at x > 100 m are refused."""

    def __init__(self, *_):
        self.client = SimpleNamespace(keys=SimpleNamespace(prefix="lab/r1"), has_nodes=lambda: True)
        self.places = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def listen(self, streams):
        estimate = PoseEstimate(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
        return SimpleNamespace(take=lambda wait: [("localizer", "main", "pose", estimate, 0)])

    def place(self, x, y, heading):
        if x > 100.0:
            raise NavloomError("localizer main takes no pose")
        self.places.append((x, y, heading))


@contextmanager
def served(network, take, publish=("pose",)):
    """What `serve` says; it runs on a thread."""
    said, ending = [], threading.Event()
    given = adapter.Serving(None, None, None, False, network.endpoint, 0, "", KILTED, publish, take)
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
        estimates.publish(**pose_at(101.0, 0.0, 0.0))
        assert until(lambda: said[1:]) == ["pose refused: localizer main takes no pose"]
        assert said[0] == f"robot lab/r1 is served in domain 0 of {network.endpoint}"


def test_without_take_nothing_is_taken_from_the_network(network, monkeypatch):
    monkeypatch.setattr(adapter, "Navigator", StandIn)
    with served(network, []), Node("rviz", router=network.endpoint, types=KILTED) as rviz:
        assert rviz.wait_for(lambda graph: graph.find("/pose", ("MP",)), 5.0)
        ours = [entity for entity in rviz.graph.entities if entity.node == "navloom_server"]
        assert {entity.name for entity in ours if entity.kind in ("MS", "SS", "SC")} == set()
        assert {entity.name for entity in ours if entity.kind == "MP"} == {"/pose"}


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


TO_POSE = "nav2_msgs/action/NavigateToPose"
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
