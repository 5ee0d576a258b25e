"""Nodes of navloom_ros on one network: topics, services, discovery, and a restart of the router."""

import os
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from navloom_ros import Types
from navloom_ros.errors import BadName, RosError, UnfitMessage
from navloom_ros.names import key_of, remapping
from navloom_ros.node import Node
from navloom_ros.qos import LATCHED, SENSOR, Qos
from navloom_ros.services import NoAnswer
from navloom_ros.tokens import Attachment
from navloom_ros.wire import Wire, settings
from ros_golden import KILTED
from ros_network import Router, until

SCAN = "sensor_msgs/msg/LaserScan"


@pytest.fixture(scope="module")
def network():
    with Router() as router:
        yield router


@pytest.fixture
def node(network, request):
    made = []

    def make(name, **options):
        made.append(Node(name, router=network.endpoint, types=options.pop("types", KILTED), **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


def linked(reader, topic, kind="MP", count=1):
    """Whether a node has discovered `count` endpoints of a kind with a name."""
    return reader.wait_for(lambda graph: len(graph.find(topic, kind)) >= count, 5.0)


def test_a_message_arrives_with_what_is_beside_it(node):
    robot, ours = node("robot"), node("ours")
    publisher = robot.publisher("scan", SCAN, SENSOR)
    scans = ours.subscription("/scan", SCAN, SENSOR)
    assert linked(robot, "/scan", "MS")
    received = until(lambda: publisher.publish(ranges=[1.0, 2.0]) or scans.take(0.02))
    assert received.message.ranges.tolist() == [1.0, 2.0]
    assert received.sequence >= 1 and received.gid == publisher.entity.gid
    assert 0 <= received.received_ns - received.source_ns < 5e9


@pytest.mark.parametrize("qos", [Qos(), SENSOR, Qos(depth=None)], ids=str)
def test_numbers_count_from_one_in_order(node, qos):
    robot, ours = node("robot"), node("ours")
    scans = ours.subscription("counted", "std_msgs/msg/Int64", Qos(depth=100))
    publisher = robot.publisher("counted", "std_msgs/msg/Int64", qos)
    assert linked(robot, "/counted", "MS") and linked(ours, "/counted")
    for value in range(50):
        publisher.publish(data=value)
    taken = [scans.take(2.0) for _ in range(50)]
    assert [(one.sequence, one.message.data) for one in taken] == [(value + 1, value) for value in range(50)]


def test_a_late_joiner_gets_the_last_of_a_latched_topic_whoever_comes_first(node):
    robot = node("robot")
    maps = robot.publisher("map", "nav_msgs/msg/OccupancyGrid", LATCHED)
    for width in (3, 4):
        maps.publish(info={"width": width, "height": 1}, data=[0] * width)
    late = node("late").subscription("map", "nav_msgs/msg/OccupancyGrid", LATCHED)
    assert late.take(5.0).message.info.width == 4 and late.take(0.05) is None
    early = node("early").subscription("costs", "nav_msgs/msg/OccupancyGrid", LATCHED)
    robot.publisher("costs", "nav_msgs/msg/OccupancyGrid", LATCHED).publish(info={"width": 9})
    assert early.take(5.0).message.info.width == 9


def test_a_queue_keeps_the_newest(node):
    robot, ours = node("robot"), node("ours")
    numbers = ours.subscription("n", "std_msgs/msg/Int64", Qos(depth=3))
    publisher = robot.publisher("n", "std_msgs/msg/Int64")
    end = ours.subscription("end", "std_msgs/msg/Empty")
    assert linked(robot, "/end", "MS") and linked(ours, "/n")
    for value in range(20):
        publisher.publish(data=value)
    robot.publisher("end", "std_msgs/msg/Empty").publish()
    assert end.take(5.0)
    assert [numbers.take().message.data for _ in range(3)] == [17, 18, 19] and numbers.take() is None


def test_what_is_no_message_is_counted_and_passed_over(node, network):
    ours = node("ours")
    scans = ours.subscription("scan", SCAN)
    key = key_of(0, "/scan", SCAN, KILTED.hash_of(SCAN))
    good = KILTED.encode(KILTED.new(SCAN, ranges=[5.0]))
    with Wire(network.endpoint, 1 << 20) as stranger:
        put, _ = stranger.publisher(key, SENSOR)
        beside = Attachment(1, 2, bytes(16)).data
        until(lambda: put(good, beside) or scans.take(0.02))
        put(b"junk", beside)
        put(good[:30], beside)
        put(good, b"short")
        put(good, beside)
        assert until(lambda: scans.take() or None).message.ranges[0] == 5.0
    assert scans.refused == 3 and "attachment of 5 bytes" in scans.reason


def test_a_message_that_is_too_large_is_not_copied(node, network):
    ours = node("ours", types=Types("kilted", largest=1000))
    scans = ours.subscription("scan", SCAN)
    robot = node("robot")
    publisher = robot.publisher("scan", SCAN)
    assert linked(robot, "/scan", "MS") and linked(ours, "/scan")
    publisher.publish(ranges=[0.0] * 5000)
    publisher.publish(ranges=[1.0])
    assert len(scans.take(5.0).message.ranges) == 1 and scans.reason.endswith("bytes; at most 1000 are received")


def test_a_service_answers_and_a_missing_one_says_so(node):
    robot, ours = node("robot"), node("ours")
    robot.service("brake", "std_srvs/srv/SetBool", lambda call: call.answer(success=call.request.data, message="ok"))
    client = ours.client("brake", "std_srvs/srv/SetBool")
    assert linked(ours, "/brake", "SS")
    assert [client.call({"data": value}).success for value in (True, False)] == [True, False]
    with pytest.raises(NoAnswer, match=r"service /none \(std_srvs/srv/Trigger\) has not answered"):
        ours.client("none", "std_srvs/srv/Trigger").call(timeout=2.0)


def test_a_service_that_fails_or_takes_too_long_leaves_nobody_waiting(node):
    robot, ours = node("robot"), node("ours")
    release = threading.Event()
    broken = robot.service("broken", "std_srvs/srv/Trigger", lambda call: 1 / 0)
    robot.service("slow", "std_srvs/srv/Trigger", lambda call: release.wait(5.0))
    assert linked(ours, "/slow", "SS") and linked(ours, "/broken", "SS")
    with pytest.raises(NoAnswer):
        ours.client("broken", "std_srvs/srv/Trigger").call(timeout=5.0)
    assert broken.failed == 1 and broken.reason == "ZeroDivisionError: division by zero"
    with pytest.raises(NoAnswer):
        ours.client("slow", "std_srvs/srv/Trigger").call(timeout=0.2)
    release.set()


def test_answers_may_come_later_and_go_to_whoever_asked(node):
    robot, ours = node("robot"), node("ours")
    calls = []
    robot.service("add", "nav_msgs/srv/LoadMap", calls.append)
    client = ours.client("add", "nav_msgs/srv/LoadMap")
    assert linked(ours, "/add", "SS")
    futures = [client.ask({"map_url": str(index)}) for index in range(5)]
    assert until(lambda: len(calls) == 5)
    for call in reversed(calls):
        call.answer(result=int(call.request.map_url))
    assert [future.result(5.0).result for future in futures] == list(range(5))


def test_the_graph_tells_names_types_and_quality(node):
    robot, ours = node("base", namespace="/r1"), node("ours")
    robot.publisher("scan", SCAN, SENSOR)
    robot.service("~/reset", "std_srvs/srv/Empty", lambda call: call.answer())
    assert linked(ours, "/r1/base/reset", "SS")
    assert ours.wait_for(lambda graph: graph.find("/r1/scan", ("MP",)), 5.0)
    (scan,) = ours.graph.find("/r1/scan", ("MP",))
    assert (scan.full_node_name, scan.type_name, scan.qos) == ("/r1/base", SCAN, SENSOR)
    assert scan.type_hash == KILTED.hash_of(SCAN)
    assert ours.wait_for(lambda graph: "/r1/base" in graph.nodes(), 5.0)
    robot.close()
    assert ours.wait_for(lambda graph: not graph.find("/r1/scan", ("MP",)), 5.0)


def test_domains_do_not_see_each_other(node):
    other, ours = node("other", domain=7), node("ours")
    publisher = other.publisher("scan", SCAN)
    scans = ours.subscription("scan", SCAN)
    publisher.publish()
    assert node("seven", domain=7).wait_for(lambda graph: graph.find("/scan", ("MP",)), 5.0)
    assert scans.take(0.05) is None and not ours.graph.find("/scan", ("MP",))
    with pytest.raises(RosError, match="ROS domain 300: expected 0 to 232"):
        node("x", domain=300)


def test_humble_and_jazzy_do_not_match_and_it_is_said(node):
    humble, ours = node("humble", types=Types("humble")), node("ours")
    publisher = humble.publisher("range", "sensor_msgs/msg/Range")
    ranges = ours.subscription("range", "sensor_msgs/msg/Range")
    assert linked(ours, "/range") and linked(humble, "/range", "MS")
    publisher.publish()
    assert ranges.take(0.05) is None
    assert [mismatch.type_hash for mismatch in ours.mismatches("range")] == ["TypeHashNotSupported"]
    theirs = node("theirs", types=Types("humble")).subscription("range", "sensor_msgs/msg/Range")
    assert until(lambda: publisher.publish(range=2.0) or theirs.take(0.02)).message.range == 2.0


def test_names_are_remapped(node):
    robot = node("robot", namespace="/r1", remap=remapping(["scan:=/front/scan"]))
    assert robot.publisher("scan", SCAN).entity.name == "/front/scan"


def test_what_does_not_fit_is_refused_before_it_is_sent(node):
    publisher = node("robot").publisher("scan", SCAN)
    with pytest.raises(UnfitMessage, match="message is std_msgs/msg/Bool; expected sensor_msgs/msg/LaserScan"):
        publisher.publish(KILTED.new("std_msgs/msg/Bool"))
    with pytest.raises(BadName):
        node("robot2").publisher("scan*", SCAN)


def test_everything_is_there_again_after_the_router_restarts():
    with Router() as router, Node("robot", router=router.endpoint, types=KILTED) as robot:
        maps = robot.publisher("map", "std_msgs/msg/Int64", LATCHED)
        robot.service("ask", "std_srvs/srv/Trigger", lambda call: call.answer(success=True))
        with Node("ours", router=router.endpoint, types=KILTED) as ours:
            numbers = ours.subscription("map", "std_msgs/msg/Int64", LATCHED)
            maps.publish(data=1)
            assert numbers.take(5.0).message.data == 1
            router.stop()
            assert ours.wait_for(lambda graph: not graph.find("/map", ("MP",)), 5.0)
            assert until(lambda: not ours.wire.joined)
            router.start()
            assert linked(ours, "/map") and linked(ours, "/ask", "SS") and linked(robot, "/map", "MS")
            maps.publish(data=2)
            assert until(lambda: numbers.take(5.0).message.data == 2)
            assert ours.client("ask", "std_srvs/srv/Trigger").call(timeout=5.0).success


def listening():
    """Local addresses of this host's listening sockets, TCP and UDP."""
    found = set()
    for table in ("tcp", "tcp6", "udp", "udp6"):
        lines = Path(f"/proc/net/{table}").read_text("ascii").splitlines()[1:]
        found |= {(table, line.split()[1], line.split()[9]) for line in lines if line.split()[3] in ("0A", "07")}
    return found


def own(sockets):
    """Those of this process, found by their inodes."""
    inodes = set()
    for link in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            inodes.add(os.readlink(link).partition("[")[2].rstrip("]"))
    return {socket for socket in sockets if socket[2] in inodes}


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="needs Linux")
def test_a_node_opens_nothing_that_listens(node):
    before = own(listening())
    node("ours").subscription("scan", SCAN)
    assert own(listening()) == before != set()  # the router's own


def test_a_session_listens_nowhere_and_searches_for_nobody():
    made = settings("tcp/127.0.0.1:7447")
    assert made["mode"] == "client" and made["listen"]["endpoints"] == []
    assert not made["scouting"]["multicast"]["enabled"] and not made["scouting"]["gossip"]["enabled"]


@pytest.mark.parametrize(("distribution", "heard"), [("lyrical", True), ("kilted", False)])
def test_a_cloud_that_goes_to_the_key_of_buffers_is_heard_in_lyrical(network, node, distribution, heard):
    cloud, types = "sensor_msgs/msg/PointCloud2", Types(distribution)
    ours = node("ours", types=types)
    clouds = ours.subscription("/points", cloud, SENSOR)
    key = key_of(0, "/points", cloud, types.hash_of(cloud))
    data = types.encode(types.new(cloud, width=3, data=np.arange(3, dtype=np.uint8)))
    with Wire(network.endpoint, 1 << 20) as wire:
        (buffers, _), (own, _) = wire.publisher(f"{key}/_buf_cpu", SENSOR), wire.publisher(key, SENSOR)
        beside = Attachment(1, 0, bytes(16)).data
        assert until(lambda: own(data, beside) or clouds.take(0.02)).message.data.tolist() == [0, 1, 2]
        until(lambda: clouds.take(0.05) is None)
        for _ in range(5):
            buffers(data, beside)
        assert (clouds.take(2.0 if heard else 0.1) is not None) == heard
