"""The mapper `ros_map` and the planner `ros_path`."""

import threading
import time

import numpy as np
import pytest
from navloom import (
    Context,
    InputError,
    MapperInput,
    MapUpdate,
    OccupancyGrid,
    Path,
    PlanFailure,
    PlannerInput,
    PlanRequest,
    Pose2D,
    PoseTrack,
    RobotSpec,
)
from navloom_ros.elsewhere.adapter import RosMap, RosPath
from navloom_ros.elsewhere.params import RosMapParams, RosPathParams
from navloom_ros.elsewhere.reading import cells_of, points_of
from navloom_ros.errors import Unusable
from navloom_ros.node import Node
from navloom_ros.qos import LATCHED
from ros_golden import KILTED
from ros_network import Router, until

SPEC = RobotSpec(np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]]), 0.5, 0.05, 0.2, 0.5, 1.0, 1.0, 1.0)
CONTEXT = Context("one", 0.05, SPEC, np.random.default_rng, Pose2D(0.0, 0.0, 0.0))
INFO = {"resolution": 0.5, "width": 3, "height": 2, "origin": {"position": {"x": -1.0, "y": 2.0}}}
CELLS = np.array([0, 100, -1, 0, 0, 50], np.int8)
TRACK = PoseTrack(np.zeros(0, np.int64), np.zeros((0, 3)))


@pytest.fixture(scope="module")
def network():
    with Router() as router, Node("elsewhere", router=router.endpoint, types=KILTED) as node:
        yield router.endpoint, node


def grid(frame="map", **info):
    return KILTED.new("nav_msgs/msg/OccupancyGrid", header={"frame_id": frame}, info=INFO | info, data=CELLS)


def path(*points, frame="map"):
    header = {"frame_id": frame}
    poses = [{"header": header, "pose": {"position": {"x": x, "y": y}}} for x, y in points]
    return KILTED.new("nav_msgs/msg/Path", header=header, poses=poses)


def asked(clear=False):
    return MapperInput(7, (), (), TRACK, clear)


def request(number=1):
    known = MapUpdate(0, OccupancyGrid(np.zeros((2, 2), np.int8), 1.0, Pose2D(0.0, 0.0, 0.0)), np.empty((0, 4)), ())
    return PlannerInput(PlanRequest(number, Pose2D(0.0, 0.0, 0.0), Pose2D(2.0, 1.0, 0.0)), known)


def test_the_map_of_a_ros_node_is_the_map(network):
    router, node = network
    mapper = RosMap(RosMapParams(router=router, distribution="kilted"), CONTEXT)
    assert mapper.update(asked()) is None
    maps = node.publisher("/map", "nav_msgs/msg/OccupancyGrid", LATCHED)
    maps.publish(grid())
    found = until(lambda: mapper.update(asked()))
    assert found.grid.cells.tolist() == [[0, 100, -1], [0, 0, 50]] and found.stamp_ns == 7
    assert (found.grid.resolution, found.grid.origin) == (0.5, Pose2D(-1.0, 2.0, 0.0))
    assert mapper.update(asked()) is None and mapper.update(asked(clear=True)).grid == found.grid
    maps.publish(grid("odom"))
    with pytest.raises(InputError, match="/map: a map in the frame 'odom'; expected 'map'"):
        until(lambda: mapper.update(asked()))
    mapper._joining.close()


def planner(router, **given):
    made = RosPath(RosPathParams(router=router, distribution="kilted", deadline=0.4, **given), CONTEXT)
    assert made._joining.start(5.0)
    return made


def test_a_path_follows_the_goal_on_a_topic(network):
    router, node = network
    goals = node.subscription("/goal_pose", "geometry_msgs/msg/PoseStamped")
    paths = node.publisher("/plan", "nav_msgs/msg/Path")
    ours = planner(router)
    assert node.wait_for(lambda graph: graph.find("/goal_pose", ("MP",)), 5.0)

    def answer():
        goal = goals.take(5.0).message.pose.position
        paths.publish(path((0.0, 0.0), (0.0, 0.0), (2.0, 0.0), (goal.x, goal.y)))

    until(lambda: isinstance(ours.plan(request()), PlanFailure) and goals.take(0.0))  # until both are discovered
    thread = threading.Thread(target=answer)
    thread.start()
    found = ours.plan(request(3))
    thread.join()
    assert isinstance(found, Path) and found.request_id == 3 and found.length == pytest.approx(3.0)
    assert found.points.tolist() == [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]]
    began = time.monotonic()
    failed = ours.plan(request())
    assert failed.detail == "no path on /plan within 0.4 s of the goal on /goal_pose"
    assert 0.35 < time.monotonic() - began < 2.0
    ours._joining.close()


def test_a_path_is_the_answer_of_a_service(network):
    router, node = network
    node.service(
        "/plan_for", "nav_msgs/srv/GetPlan",
        lambda call: call.answer(plan=path((call.request.start.pose.position.x, 0.0), (2.0, 1.0))),
    )  # fmt: skip
    ours = planner(router, service="/plan_for")
    found = until(lambda: isinstance(made := ours.plan(request()), Path) and made)
    assert found.points.tolist() == [[0.0, 0.0], [2.0, 1.0]]
    ours._joining.close()


def test_a_planner_without_a_network_says_so():
    ours = RosPath(RosPathParams(router="tcp/127.0.0.1:1"), CONTEXT)
    failed = ours.plan(request())
    assert failed.kind == "no_path" and "127.0.0.1:1" in failed.detail
    ours._joining.close()


@pytest.mark.parametrize("wrong", [{"width": 4}, {"resolution": 0.0}, {"origin": {"position": {"x": float("nan")}}}])
def test_a_map_that_means_nothing_is_unusable(wrong):
    with pytest.raises(Unusable):
        cells_of(grid(**wrong))


@pytest.mark.parametrize(
    "wrong", [path((0.0, 0.0)), path((0.0, 0.0), (1.0, 0.0), frame="odom"), path((0.0, 0.0), (float("inf"), 0.0))]
)
def test_a_path_that_means_nothing_is_unusable(wrong):
    with pytest.raises(Unusable):
        points_of(wrong, "map")
