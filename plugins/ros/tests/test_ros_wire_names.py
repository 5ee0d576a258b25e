"""Names, keys, tokens, attachments and QoS texts: those of rmw_zenoh, and invalid ones."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom_ros.errors import BadName, BadToken
from navloom_ros.graph import Graph
from navloom_ros.names import check_namespace, check_node_name, dds_type, full_name, key_of, remapping, ros_type
from navloom_ros.qos import DEFAULT, LATCHED, SENSOR, Qos
from navloom_ros.tokens import Attachment, Entity
from ros_golden import HASHES

SESSION = "aac3178e146ba6f1fc6e6a4085e77f21"
STRING = HASHES["std_msgs/msg/String"]
CAPTURED = bytes.fromhex("d80000000000000034dae10162f8c41810f07168d3856ce9f689254cbed6252151")
CAPTURED_TOKEN = (
    "@ros2_lv/0/9ca0f8facf84ffb1e6bfa4f2500889f0/0/3/MP/%/%/_ros2cli_712/%chatter/std_msgs::msg::dds_::String_/"
    "TypeHashNotSupported/:1:,1:,:,:,,"
)
"""Attachment and token of a live publisher of ROS 2 Humble, captured by the authors of dora-rs."""
LISTENER = f"@ros2_lv/2/{SESSION}/0/0/NN/%/%/listener"
CHATTER = f"@ros2_lv/0/{SESSION}/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{STRING}/::,7:,:,:,,"
"""Tokens as rmw_zenoh's own documentation shows them."""


def test_the_key_of_a_topic_is_rmw_zenohs():
    assert key_of(0, "/chatter", "std_msgs/msg/String", STRING) == f"0/chatter/std_msgs::msg::dds_::String_/{STRING}"
    assert key_of(7, "/r1/scan", "sensor_msgs/msg/LaserScan", "TypeHashNotSupported").startswith(
        "7/r1/scan/sensor_msgs::"
    )


@pytest.mark.parametrize(
    ("ros", "wire"),
    [
        ("sensor_msgs/msg/LaserScan", "sensor_msgs::msg::dds_::LaserScan_"),
        ("nav_msgs/srv/GetMap", "nav_msgs::srv::dds_::GetMap_"),
        ("nav2_msgs/action/NavigateToPose_SendGoal", "nav2_msgs::action::dds_::NavigateToPose_SendGoal_"),
    ],
)
def test_types_are_written_as_on_the_wire_and_back(ros, wire):
    assert dds_type(ros) == wire and ros_type(wire) == ros


def test_a_node_token_is_read_and_written():
    entity = Entity.parsed(LISTENER)
    assert (entity.kind, entity.domain, entity.full_node_name, entity.namespace) == ("NN", 2, "/listener", "/")
    assert entity.token == LISTENER


def test_a_publishers_token_is_read_and_written():
    entity = Entity.parsed(CHATTER)
    assert (entity.name, entity.type_name, entity.type_hash) == ("/chatter", "std_msgs/msg/String", STRING)
    assert (entity.node_id, entity.entity_id, entity.qos) == ("0", "10", Qos(depth=7))
    assert entity.token == CHATTER


def test_parts_that_a_newer_version_appends_are_passed_over():
    assert Entity.parsed(f"{CHATTER}/backends").token == CHATTER


def test_namespaces_are_in_the_token():
    entity = Entity(
        "MS", 0, SESSION, "1", "2", "/r1/front", "laser", "/r1/scan", "sensor_msgs/msg/LaserScan", STRING, SENSOR
    )
    assert "/MS/%/%r1%front/laser/%r1%scan/sensor_msgs::msg::dds_::LaserScan_/" in entity.token
    assert entity.token.endswith("/2::,5:,:,:,,")
    assert Entity.parsed(entity.token) == entity


@pytest.mark.parametrize(
    "token",
    [
        "",
        "@ros2_lv",
        "@ros2_lv/0/a/0/0/NN/%/%",
        "@ros2_lv/x/a/0/0/NN/%/%/n",
        CHATTER.replace("MP", "XX"),
        CHATTER.rpartition("/")[0],
        CHATTER.replace("::,7:,:,:,,", "::,x:,:,:,,"),
        CHATTER.replace("::,7:,:,:,,", ""),
        "@ros2_lv/0/a/0/0/NN/%/%/" + "n" * 5000,
    ],
)
def test_what_is_no_token_is_refused(token):
    with pytest.raises(BadToken):
        Entity.parsed(token)


@given(st.text(max_size=200))
def test_any_text_as_a_token_gives_an_entity_or_the_one_error(text):
    for token in (text, f"@ros2_lv/{text}", CHATTER.replace("talker", text), CHATTER + text):
        try:
            Entity.parsed(token)
        except BadToken:
            continue


def test_the_gid_of_a_live_publisher_is_the_hash_of_its_token():
    assert Entity.parsed(CAPTURED_TOKEN).gid == Attachment.parsed(CAPTURED).gid
    assert Entity.parsed(CAPTURED_TOKEN).qos == LATCHED


def test_the_captured_attachment_is_read_and_written():
    attachment = Attachment.parsed(CAPTURED)
    assert (attachment.sequence, attachment.source_ns) == (216, 1784824452167621172)
    assert attachment.gid.hex() == "f07168d3856ce9f689254cbed6252151"
    assert attachment.data == CAPTURED


@pytest.mark.parametrize("data", [b"", CAPTURED[:-1], CAPTURED[:16] + b"\x08" + CAPTURED[17:]])
def test_what_is_no_attachment_is_refused(data):
    with pytest.raises(BadToken, match="attachment"):
        Attachment.parsed(data)


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (LATCHED, ":1:,1:,:,:,,"),
        (SENSOR, "2::,5:,:,:,,"),
        (DEFAULT, "::,10:,:,:,,"),
        (Qos(depth=42), "::,:,:,:,,"),
        (Qos(depth=None), "::2,:,:,:,,"),
    ],
)
def test_qos_is_written_as_rmw_zenoh_does(qos, text):
    assert qos.text == text and Qos.parsed(text) == qos


def test_qos_with_every_part_given_is_read():
    assert Qos.parsed("1:2:1,42:9,5:9223372036,854775807:1,9223372036,854775807") == Qos(depth=42)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("scan", "/r1/scan"),
        ("/scan", "/scan"),
        ("~/scan", "/r1/laser/scan"),
        ("a/b_2", "/r1/a/b_2"),
        ("~", "/r1/laser"),
    ],
)
def test_names_are_expanded_as_ros_does(name, expected):
    assert full_name(name, "/r1", "laser") == expected


@pytest.mark.parametrize("name", ["", "/", "a//b", "a/", "2d", "a b", "scan*", "a/$b", "~x", "a/../b", "ä", "x" * 300])
def test_names_that_ros_does_not_allow_are_refused(name):
    with pytest.raises(BadName, match="name"):
        full_name(name, "/r1", "laser")


def test_remapping_is_of_expanded_names():
    rules = remapping(["scan:=/front/scan", "~/odom:=odom"])
    assert full_name("scan", "/r1", "nav", rules) == "/front/scan"
    assert full_name("/r1/scan", "/r1", "nav", rules) == "/front/scan"
    assert full_name("~/odom", "/r1", "nav", rules) == "/r1/odom"
    assert full_name("/scan", "/r1", "nav", rules) == "/scan"
    with pytest.raises(BadName, match="expected OLD:=NEW"):
        remapping(["scan=front"])


def test_namespaces_and_node_names_are_checked():
    assert [check_namespace(one) for one in ("", "/", "r1", "/r1/a")] == ["/", "/", "/r1", "/r1/a"]
    with pytest.raises(BadName, match="node name 'a/b'"):
        check_node_name("a/b")


def test_the_graph_knows_who_offers_what():
    graph = Graph()
    goal = "nav2_msgs/action/NavigateToPose_SendGoal"
    entities = [
        Entity("NN", 0, SESSION, "0", "0", "/r1", "nav"),
        Entity("MP", 0, SESSION, "0", "1", "/r1", "nav", "/plan", "nav_msgs/msg/Path", "h", DEFAULT),
        Entity("MS", 0, SESSION, "0", "2", "/r1", "nav", "/scan", "sensor_msgs/msg/LaserScan", "h", SENSOR),
        Entity("SS", 0, SESSION, "0", "3", "/r1", "nav", "/map", "nav_msgs/srv/GetMap", "h", DEFAULT),
        Entity("SS", 0, SESSION, "0", "4", "/r1", "nav", "/go/_action/send_goal", goal, "h", DEFAULT),
    ]
    for entity in entities:
        graph.add(entity.token)
        graph.add(entity.token)
    assert graph.nodes() == ["/r1/nav"]
    assert {name: listed.types for name, listed in graph.topics().items()} == {
        "/plan": ["nav_msgs/msg/Path"],
        "/scan": ["sensor_msgs/msg/LaserScan"],
    }
    assert list(graph.services()) == ["/map"] and graph.actions()["/go"].types == ["nav2_msgs/action/NavigateToPose"]
    assert graph.add("@ros2_lv/junk") is None and graph.unread == 1
    graph.remove(entities[1].token)
    assert list(graph.topics()) == ["/scan"]
