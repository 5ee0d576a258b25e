"""Output of `navloom ros graph` and `navloom ros echo`."""

import json
import threading

import pytest
from navloom_ros.cli import app
from navloom_ros.message_types import Types
from navloom_ros.node import Node
from navloom_ros.qos import LATCHED, SENSOR
from navloom_ros.wire import Wire
from ros_golden import KILTED
from ros_network import Router, free_port
from typer.testing import CliRunner


@pytest.fixture(scope="module")
def network():
    with Router() as router, Node("base", namespace="/r1", router=router.endpoint, types=KILTED) as robot:
        robot.publisher("scan", "sensor_msgs/msg/LaserScan", SENSOR)
        maps = robot.publisher("map", "nav_msgs/msg/OccupancyGrid", LATCHED)
        maps.publish(info={"width": 40, "height": 1, "resolution": float("inf")}, data=[0, 100] * 20)
        robot.service("brake", "std_srvs/srv/SetBool", lambda call: call.answer())
        with Node("old", router=router.endpoint, types=Types("humble")) as humble:
            humble.publisher("battery", "sensor_msgs/msg/BatteryState", LATCHED).publish(voltage=12.5)
            robot.subscription("/battery", "sensor_msgs/msg/BatteryState")
            yield router


def run(network, *arguments):
    return CliRunner().invoke(app, [*arguments, "--router", network.endpoint])


def test_graph_lists_who_offers_what(network):
    done = run(network, "graph")
    assert done.exit_code == 0, done.output
    for line in (
        "  /r1/base",
        "  /r1/scan  sensor_msgs/msg/LaserScan  1 publishers, 0 subscriptions  (best effort, depth 5)",
        "  /r1/map  nav_msgs/msg/OccupancyGrid  1 publishers, 0 subscriptions  (reliable, transient local, depth 1)",
        "  /r1/brake  std_srvs/srv/SetBool  1 servers, 0 clients",
        "actions: none",
    ):
        assert line in done.output.splitlines()
    assert "/battery  sensor_msgs/msg/BatteryState" in done.output and "TYPES OR HASHES DIFFER" in done.output
    assert "navloom_" not in done.output


def test_graph_for_scripts(network):
    found = json.loads(run(network, "graph", "--json").output)
    assert found["nodes"] == ["/old", "/r1/base"]
    (scan,) = [topic for topic in found["topics"] if topic["name"] == "/r1/scan"]
    assert scan["publishers"][0]["hash"] == KILTED.hash_of("sensor_msgs/msg/LaserScan") and scan["matches"]


def test_a_line_end_in_a_name_forges_no_line_of_the_graph(network):
    with Wire(network.endpoint, 1 << 20) as stranger:
        withdraw = stranger.token("@ros2_lv/0/abc/0/0/NN/%/%/evil\n  fake")
        lines = run(network, "graph").output.splitlines()
        assert "  fake" not in lines and r"  /evil\n  fake" in lines
        withdraw()


def test_graph_says_what_it_cannot_read(network):
    with Wire(network.endpoint, 1 << 20) as stranger:
        withdraw = stranger.token("@ros2_lv/0/what")
        done = run(network, "graph")
        assert "not listed: 1 entries that cannot be read, such as token '@ros2_lv/0/what': expected" in done.output
        assert json.loads(run(network, "graph", "--json").output)["unread"] == 1
        withdraw()


def test_echo_prints_the_latched_map_at_once(network):
    done = run(network, "echo", "/r1/map", "--count", "1")
    assert done.exit_code == 0, done.output
    assert "  width: 40" in done.output and "… 40 elements" in done.output
    done = run(network, "echo", "r1/map", "--count", "1", "--json", "--whole")
    message = json.loads(done.output)["message"]
    assert message["data"] == [0, 100] * 20 and message["info"]["resolution"] == "inf"


def test_echo_goes_on_until_it_has_what_was_asked_for(network):
    stop = threading.Event()
    with Node("ticker", router=network.endpoint, types=KILTED) as ticker:
        numbers = ticker.publisher("ticks", "std_msgs/msg/Int64")
        ticking = threading.Thread(target=lambda: [numbers.publish(data=n) for n in range(5000) if not stop.wait(0.01)])
        ticking.start()
        done = run(network, "echo", "/ticks", "--count", "5", "--json")
        stop.set()
        ticking.join()
    values = [json.loads(line)["message"]["data"] for line in done.output.splitlines()]
    assert values == list(range(values[0], values[0] + 5))


def test_echo_finds_the_distribution_by_the_hash(network):
    done = run(network, "echo", "/battery", "--count", "1", "--json")
    assert json.loads(done.output)["message"]["voltage"] == 12.5
    done = run(network, "echo", "/battery", "--distro", "kilted")
    assert done.exit_code == 2 and "TypeHashNotSupported, which kilted has: give" in done.output


def test_echo_of_nothing_says_what_there_is(network):
    done = run(network, "echo", "/none", "--wait", "0.1")
    assert done.exit_code == 1
    assert "/none: no node publishes it in domain 0; topics there: /battery, /r1/map, /r1/scan" in done.output
    done = run(network, "echo", "/r1/scan", "--wait", "0.1")
    assert done.exit_code == 1 and "/r1/scan: no message within 0.1 s" in done.output


def test_wrong_requests_are_one_line(network):
    for arguments, said in (
        (["echo", "/a b"], "name '/a b': expected parts"),
        (["echo", "/r1/scan", "--distro", "noetic"], "ROS 2 distribution 'noetic': expected one of humble"),
        (["echo", "/r1/scan", "--interfaces", "/none"], "/none: no such folder"),
    ):
        done = run(network, *arguments)
        assert done.exit_code == 2 and said in done.output and len(done.output.splitlines()) == 1, done.output
    done = CliRunner().invoke(app, ["graph", "--router", f"tcp/127.0.0.1:{free_port()}"])
    assert done.exit_code == 1 and "no Zenoh router at tcp/" in done.output
