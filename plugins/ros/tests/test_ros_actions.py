"""An action server and a client of navloom_ros: goals are accepted, rejected, ended, cancelled and replaced."""

import threading

import pytest
from navloom_ros.actions import ABORTED, CANCELED, SUCCEEDED, ActionClient, ActionServer
from navloom_ros.message_types import Types
from navloom_ros.node import Node
from navloom_ros.qos import LATCHED
from navloom_ros.services import NoAnswer
from ros_golden import KILTED
from ros_network import Router, until

TO_POSE = "nav2_msgs/action/NavigateToPose"


@pytest.fixture(scope="module")
def network():
    with Router() as router:
        yield router


class Robot:
    """Accepts goals with x >= 0; each goal waits in `goals` until the test ends it."""

    def __init__(self, node):
        self.goals = []
        self.may_cancel = True
        self.server = ActionServer(
            node,
            "navigate_to_pose",
            TO_POSE,
            self.goals.append,
            accept=lambda goal: goal.pose.pose.position.x >= 0.0,
            cancel=lambda goal: self.may_cancel,
        )

    def next_goal(self, number=1):
        assert until(lambda: len(self.goals) >= number)
        return self.goals[number - 1]


@pytest.fixture(params=["kilted", "humble"])
def pair(network, request):
    types = KILTED if request.param == "kilted" else Types(request.param)
    with (
        Node("robot", router=network.endpoint, types=types) as robot,
        Node("ours", router=network.endpoint, types=types) as ours,
    ):
        there = Robot(robot)
        client = ActionClient(ours, "navigate_to_pose", TO_POSE)
        assert client.wait(5.0)
        yield there, client, ours


def to(x, y=0.0):
    return {"pose": {"header": {"frame_id": "map"}, "pose": {"position": {"x": x, "y": y}}}}


def test_a_goal_is_accepted_fed_back_and_succeeds(pair):
    robot, client, _ = pair
    told = []
    sent = client.send(to(2.0, 1.0), told.append)
    goal = robot.next_goal()
    assert sent.is_accepted and (goal.request.pose.pose.position.y, goal.request.pose.header.frame_id) == (1.0, "map")
    result = sent.result(10.0)
    goal.execute()
    goal.feedback(distance_remaining=1.5, number_of_recoveries=2)
    assert until(lambda: told) and (told[0].distance_remaining, told[0].number_of_recoveries) == (1.5, 2)
    assert not result.done()
    goal.succeed()
    assert result.result(5.0).status == SUCCEEDED
    assert sent.result(5.0).result(5.0).status == SUCCEEDED  # the server keeps the result


def test_a_goal_is_rejected(pair):
    robot, client, _ = pair
    sent = client.send(to(-1.0))
    assert not sent.is_accepted and not robot.goals
    assert sent.result(5.0).result(5.0).status == 0


def test_a_goal_is_aborted_with_its_reason(network):
    with (
        Node("robot", router=network.endpoint, types=KILTED) as node,
        Node("ours", router=network.endpoint, types=KILTED) as ours,
    ):
        robot, client = Robot(node), ActionClient(ours, "navigate_to_pose", TO_POSE)
        assert client.wait(5.0)
        sent = client.send(to(1.0))
        robot.next_goal().abort(error_code=9003, error_msg="too slow")
        ended = sent.result(5.0).result(5.0)
        assert (ended.status, ended.result.error_code, ended.result.error_msg) == (ABORTED, 9003, "too slow")


def test_a_goal_is_cancelled_when_the_robot_says_so(pair):
    robot, client, _ = pair
    sent = client.send(to(1.0))
    goal = robot.next_goal()
    robot.may_cancel = False
    assert not sent.cancel() and not goal.is_canceling
    robot.may_cancel = True
    result = sent.result(10.0)
    assert sent.cancel() and goal.is_canceling and not result.done()
    goal.canceled()
    assert result.result(5.0).status == CANCELED
    assert not sent.cancel()  # it has ended


def test_a_new_goal_pre_empts_the_old_one(pair):
    robot, client, _ = pair
    first, second = client.send(to(1.0)), client.send(to(2.0))
    old, new = robot.next_goal(1), robot.next_goal(2)
    ended = first.result(5.0)
    old.abort()
    new.succeed()
    new.abort()  # no effect: it has already ended
    assert (ended.result(5.0).status, second.result(5.0).result(5.0).status) == (ABORTED, SUCCEEDED)


def test_whoever_asks_without_a_name_cancels_all(pair):
    robot, client, _ = pair
    client.send(to(1.0)), client.send(to(2.0))
    robot.next_goal(2)
    response = client.cancel_goal.call()
    assert response.return_code == 0 and len(response.goals_canceling) == 2
    assert all(goal.is_canceling for goal in robot.goals)


def test_the_states_of_all_goals_are_latched(pair):
    robot, client, ours = pair
    client.send(to(1.0))
    robot.next_goal().execute()
    statuses = ours.subscription("navigate_to_pose/_action/status", "action_msgs/msg/GoalStatusArray", LATCHED)
    assert until(lambda: (got := statuses.take(0.1)) and [status.status for status in got.message.status_list] == [2])


def test_the_graph_knows_the_action(pair):
    _, _, ours = pair
    listed = ours.graph.actions()["/navigate_to_pose"]
    assert listed.types == [TO_POSE] and (len(listed.providers), len(listed.users)) == (1, 1)
    assert not [name for name in (*ours.graph.topics(), *ours.graph.services()) if "navigate" in name]


def test_a_client_without_a_server_is_told(network):
    with Node("ours", router=network.endpoint, types=KILTED) as ours:
        client = ActionClient(ours, "nowhere", TO_POSE)
        assert not client.wait(0.05)
        with pytest.raises(NoAnswer, match="service /nowhere/_action/send_goal"):
            client.send(to(1.0))


def test_clients_do_not_get_the_feedback_of_others(pair):
    robot, client, _ = pair
    mine, other = [], []
    client.send(to(1.0), mine.append), client.send(to(2.0), other.append)
    first, second = robot.next_goal(1), robot.next_goal(2)
    second.feedback(distance_remaining=2.0)
    first.feedback(distance_remaining=1.0)
    assert until(lambda: mine and other)
    assert [one.distance_remaining for one in (*mine, *other)] == [1.0, 2.0]


def test_a_goal_that_cannot_be_started_is_aborted_and_bad_listeners_harm_no_other(network):
    with (
        Node("robot", router=network.endpoint, types=KILTED) as node,
        Node("ours", router=network.endpoint, types=KILTED) as ours,
    ):
        goals = []

        def start(goal):
            goals.append(goal)
            if goal.request.pose.pose.position.x > 5.0:
                raise RuntimeError("too far")

        ActionServer(node, "navigate_to_pose", TO_POSE, start)
        client, told = ActionClient(ours, "navigate_to_pose", TO_POSE), []
        assert client.wait(5.0)
        assert client.send(to(9.0)).result(5.0).result(5.0).status == ABORTED
        client.send(to(1.0), lambda feedback: 1 / 0), client.send(to(2.0), told.append)
        assert until(lambda: len(goals) == 3)
        goals[1].feedback(distance_remaining=1.0)
        goals[2].feedback(distance_remaining=2.0)
        assert until(lambda: told) and client.failed == 1 and "ZeroDivisionError" in client.reason


def test_asking_after_the_end_is_answered_at_once(network):
    with Node("ours", router=network.endpoint, types=KILTED) as ours:
        client = ours.client("brake", "std_srvs/srv/SetBool")
    with pytest.raises(NoAnswer):
        client.call({"data": True}, timeout=60.0)


def test_closing_the_client_ends_what_waits(network):
    with Node("robot", router=network.endpoint, types=KILTED) as node:
        robot = Robot(node)
        ours = Node("ours", router=network.endpoint, types=KILTED)
        client = ActionClient(ours, "navigate_to_pose", TO_POSE)
        assert client.wait(5.0)
        result = client.send(to(1.0)).result(600.0)
        assert robot.next_goal()
        ended = threading.Event()
        result.add_done_callback(lambda _: ended.set())
        ours.close()
        assert ended.wait(5.0) and isinstance(result.exception(), NoAnswer)
