"""A robot seen from outside: its nodes, the streams that a key matches, and summaries of messages."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from described import KEYS, PLACES, BusInWords, client, everyone, heard, wire
from navloom.messages import (
    Contact,
    Feedback,
    GateStatus,
    GoalResult,
    GoalState,
    Hypotheses,
    Message,
    Parameters,
    Point2D,
    Pose2D,
    PoseEstimate,
    RangeScan,
    StopReason,
    Twist2D,
)
from navloom.navigation.status_words import NO_GOAL, WAITS, progress, who_drives, why_stopped
from navloom_live.cli.status import rows
from navloom_live.live.mailbox import Mailbox
from navloom_live.operating.introspection import (
    NoStream,
    changed_parameters,
    envelope_fields,
    last_words,
    message_fields,
    resolve,
    retained,
    streams,
    tap,
)
from navloom_live.operating.robot_nodes import Missing, Node, listing, missing, neighbours_names, platform_age
from navloom_live.transport.zenoh_bus import Answer


def names(nodes: list[Node]) -> list[str]:
    return [node.name for node in nodes]


# --- nodes ----------------------------------------------------------------------------------------------------------


def test_nodes_are_listed_in_the_order_of_the_graph() -> None:
    found = listing(client(BusInWords(everyone()[::-1])))
    assert names(found) == list(PLACES)
    assert all(node.description is not None for node in found)


def test_a_node_that_is_announced_but_silent_is_listed_with_its_process() -> None:
    nodes = [node for node in everyone() if node.role != "avoider"]
    found = listing(client(BusInWords(nodes, silent=["avoider vfh"])))
    assert names(found) == list(PLACES)
    mute = found[5]
    assert (mute.description, mute.process, mute.unreadable) == (None, "drive", "")
    assert missing(found) == []


def test_nodes_of_the_config_that_are_not_announced_are_missing_with_process_and_host() -> None:
    hosts = {"robot": "base", "safe": "base", "think": "brain"}
    nodes = [replace(node, hosts=hosts) for node in everyone() if node.process not in ("think", "drive")]
    assert missing(listing(client(BusInWords(nodes)))) == [
        Missing("mapper", "grid", "think", "brain"),
        Missing("goal", "main", "think", "brain"),
        Missing("controller", "law", "drive", ""),
        Missing("avoider", "vfh", "drive", ""),
    ]


def test_other_robots_on_the_network_are_named_once() -> None:
    others = ["lab/r2/gate/main/alive/1", "lab/r2/goal/main/alive/1", "far/r1/gate/main/alive/9"]
    assert neighbours_names(client(BusInWords(everyone(), others=others))) == ["far/r1", "lab/r1", "lab/r2"]


# --- status ---------------------------------------------------------------------------------------------------------


def test_the_last_status_messages_are_read_from_their_publishers() -> None:
    feedback = Feedback(3, "driving", 1.5, 4.0, 0.01, 0)
    words = last_words(client(BusInWords(everyone(), last={"goal/main/feedback": feedback})))
    assert words == {"goal/feedback": feedback, "goal/result": None, "gate/status": None, "gate/selection": None}


def test_changed_parameters_are_listed_by_node_and_unchanged_ones_are_not() -> None:
    last = {
        "controller/law/parameters": Parameters(2, ("k1 = 0.8", "k3 = 1.0")),
        "avoider/vfh/parameters": Parameters(0, ()),
    }
    bus = BusInWords(everyone(), last=last)
    assert changed_parameters(client(bus)) == {"controller law": ["k1 = 0.8", "k3 = 1.0"]}


def test_the_age_of_the_platform_is_that_at_the_gate_or_else_at_any_node() -> None:
    nodes = everyone(gate={"silence_s": 0.4}, mapper={"silence_s": 0.1})
    assert platform_age(heard(nodes)) == 0.4
    assert platform_age(heard([node for node in nodes if node.role != "gate"])) == 0.02
    assert platform_age(heard(everyone(**{node.role: {"silence_s": None} for node in nodes}))) is None


@pytest.mark.parametrize(
    ("reason", "words", "remedy"),
    [
        ("operator", "by an operator", "navloom resume"),
        ("contact", "it touched something", "navloom resume"),
        ("no_trajectory", "no path to follow", "navloom goal"),
        ("ending", "its gate has ended", "navloom up"),
        ("silent: platform", "the platform is silent", "navloom doctor"),
        ("silent: sensor sonars", "sensor sonars is silent", "navloom hz"),
        ("gone: goal main does not step", "its goal node does not step", "navloom doctor"),
        ("stale: goal main", "its goal node does not step", "navloom doctor"),
        ("gone: localizer odometry", "localizer odometry is gone", "navloom doctor"),
        ("stale: controller law", "controller law gives commands from old data", "too slow"),
        ("stale: operator main", "the operator gives commands from old data", "too slow"),
        ("old_selection: avoider vfh", "avoider vfh does not know of the last swap", "next step"),
        ("of a later version", "of a later version", "navloom echo gate/status"),
    ],
)
def test_every_reason_for_a_stop_is_explained_with_a_remedy(reason: str, words: str, remedy: str) -> None:
    told, advice = why_stopped(GateStatus("none", "", True, False, StopReason.parse(reason), ()))
    assert told == words and remedy in advice


def test_every_state_of_an_active_goal_says_why_the_robot_is_stopped() -> None:
    assert set(WAITS) == set(get_args(GoalState)) - {"idle"}


REACHED = GoalResult(1, "succeeded", "the goal was reached", Point2D(0.0, 0.0))


@pytest.mark.parametrize(
    ("feedback", "result", "words"),
    [
        (NO_GOAL, None, "stopped: no goal"),
        (NO_GOAL, REACHED, "stopped: goal reached"),
        (NO_GOAL, replace(REACHED, outcome="cancelled"), "stopped: no goal"),
        (replace(NO_GOAL, goal_id=2, state="mapping"), REACHED, "stopped: it waits for a map"),
        (replace(NO_GOAL, goal_id=2, state="planning"), REACHED, "stopped: it waits for a path"),
        (replace(NO_GOAL, goal_id=2, state="searching"), REACHED, "stopped: it does not know where it is"),
    ],
    ids=["new", "reached", "cancelled", "mapping", "planning", "searching"],
)
def test_a_robot_without_a_path_is_not_reported_as_a_fault(
    feedback: Feedback, result: GoalResult | None, words: str
) -> None:
    status = GateStatus("none", "", True, False, StopReason("no_trajectory"), ())
    assert who_drives(status, feedback, result) == words
    assert ("navloom goal X Y" in why_stopped(status, feedback, result)[1]) == (feedback.goal_id == 0)


@pytest.mark.parametrize(
    ("feedback", "words"),
    [
        (Feedback(1, "driving", 3.125, 8.4, -0.04, 0), "driving, 3.12 m and 8 s left, 0.40 m/s, cross-track -0.04 m"),
        (Feedback(1, "driving", 3.125, 8.4, 0.0, 2),
         "driving, 3.12 m and 8 s left, 0.40 m/s, recoveries 2, cross-track +0.00 m"),
        (Feedback(1, "driving", 0.0, 0.0, 0.0, 0), "planning, 0.40 m/s"),
        (Feedback(1, "recovering", 0.0, 0.0, 0.0, 1), "recovering, 0.40 m/s, recoveries 1"),
        (Feedback(1, "searching", 0.0, 0.0, 0.0, 0, "lost: 24% of the echoes fit"),
         "searching, localizer lost: 24% of the echoes fit, 0.40 m/s"),
    ],
    ids=["driving", "after recoveries", "path not followed yet", "recovering", "lost"],
)  # fmt: skip
def test_the_progress_of_a_goal_has_the_remaining_way_and_what_delays_it(feedback: Feedback, words: str) -> None:
    assert progress(feedback, "0.40 m/s") == words


def status_rows(last: dict[str, Message]) -> dict[str, str]:
    asked = client(BusInWords(everyone(), last=last))
    return dict(rows("lab/r1", listing(asked), last_words(asked), changed_parameters(asked)))


def test_status_lists_the_likeliest_places_of_a_robot_that_searches() -> None:
    poses = np.array([(1.0, 2.0, 0.0), (3.0, -4.0, math.pi / 2), (0.0, 0.0, 0.0), (5.0, 5.0, 0.0), (6.0, 6.0, 0.0)])
    places = Hypotheses(0, poses, np.array([0.5, 0.25, 0.1, 0.05, 0.05]))
    nodes, still = everyone(), Twist2D(0.0, 0.0, 0.0)
    words = {"goal/feedback": None, "goal/result": None, "gate/status": None, "gate/selection": None}
    for doubt, shown in (
        ("searching", "(1.00, 2.00), 0° (50 %); (3.00, -4.00), 90° (25 %); (0.00, 0.00), 0° (10 %); 2 more"),
        ("tracking", None),
    ):
        reason = "" if doubt == "tracking" else "several places fit"
        pose = PoseEstimate(0, Pose2D(1.0, 2.0, 0.0), still, np.zeros((3, 3)), doubt, reason)  # type: ignore[arg-type]
        found = dict(rows("lab/r1", listing(client(BusInWords(nodes))), words, {}, (), pose, places))
        assert found.get("may be at") == shown


def test_status_of_a_robot_that_has_reached_its_goal_shows_no_fault() -> None:
    last: dict[str, Message] = {
        "goal/main/feedback": Feedback(0, "idle", 0.0, 0.0, 0.0, 0),
        "goal/main/result": GoalResult(2, "succeeded", "the goal was reached", Point2D(1.0, 2.0)),
        "gate/main/status": GateStatus("none", "", True, False, StopReason("no_trajectory"), ()),
    }
    found = status_rows(last)
    assert found["stopped"] == "goal reached; `navloom goal X Y` gives it a goal" and "drives" not in found
    del last["goal/main/feedback"], last["goal/main/result"]
    assert status_rows(last)["stopped"] == "no goal; `navloom goal X Y` gives it a goal"


def test_status_of_a_lost_robot_says_so_with_a_remedy() -> None:
    last: dict[str, Message] = {
        "goal/main/feedback": Feedback(2, "searching", 0.0, 0.0, 0.0, 0, "lost: 24% of the echoes fit the map"),
        "gate/main/status": GateStatus("none", "", True, False, StopReason("no_trajectory"), ()),
    }
    found = status_rows(last)
    assert found["goal"] == "2: searching, localizer lost: 24% of the echoes fit the map"
    assert found["stopped"].startswith("it does not know where it is; `navloom place X Y HEADING`")
    assert found["localizer"].startswith("lost: 24% of the echoes fit the map; `navloom place X Y HEADING`")
    last["goal/main/feedback"] = Feedback(0, "idle", 0.0, 0.0, 0.0, 0, "lost: 24% of the echoes fit the map")
    assert status_rows(last)["stopped"].endswith("the row above comes first, then `navloom goal X Y` gives it a goal")
    last["goal/main/feedback"] = Feedback(2, "driving", 1.0, 2.0, 0.0, 0)
    assert "localizer" not in status_rows(last)


def test_a_driving_robot_has_no_explanation_of_a_stop() -> None:
    assert why_stopped(GateStatus("controller", "law", False, False, None, ())) == ("", "")


# --- streams --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "found"),
    [
        ("platform/sim/odometry", ["platform/sim/odometry"]),
        ("/platform/odometry/", ["platform/sim/odometry"]),
        ("platform", ["platform/sim/odometry", "platform/sim/sonars", "platform/sim/step"]),
        ("*/command", ["avoider/vfh/command", "controller/law/command", "gate/main/command"]),
        ("*/main/status", ["gate/main/status"]),
        ("avoider/*", ["avoider/vfh/command", "avoider/vfh/status", "avoider/vfh/step"]),
    ],
)
def test_a_key_selects_the_streams_that_match(key: str, found: list[str]) -> None:
    assert resolve(key, listing(client(BusInWords(everyone())))) == found


def test_a_star_selects_every_stream() -> None:
    nodes = listing(client(BusInWords(everyone())))
    assert resolve("*", nodes) == resolve("*/*/*", nodes) == streams(nodes)
    assert len(streams(nodes)) == 12 + 7


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("platform/odometri", "did you mean 'platform/odometry'?"),
        ("avoider/vhf/command", "did you mean 'avoider/vfh/command'?"),
        ("platform/laser_in_front", "there are platform/odometry, platform/sonars, platform/step"),
        ("wheels", "there are avoider, controller, gate, goal, localizer, mapper, platform"),
        ("a/b/c/d", "there are avoider, controller, gate, goal, localizer, mapper, platform"),
        ("", "there are avoider, controller, gate, goal, localizer, mapper, platform"),
    ],
)
def test_an_unknown_key_names_the_nearest(key: str, hint: str) -> None:
    with pytest.raises(NoStream) as caught:
        resolve(key, listing(client(BusInWords(everyone()))))
    assert str(caught.value) == f"no stream {key!r}: expected role/port or role/instance/port; {hint}"


def test_a_stream_of_a_missing_node_is_distinguished_from_a_wrong_name() -> None:
    nodes = [node for node in everyone() if node.process != "drive"]
    found = listing(client(BusInWords(nodes, silent=["avoider vfh"])))
    with pytest.raises(NoStream, match="no stream 'controller/command': controller law is missing; `navloom doctor`"):
        resolve("controller/command", found)
    with pytest.raises(NoStream, match="no stream 'avoider/vfh/status': avoider vfh does not answer; `navloom doctor`"):
        resolve("avoider/vfh/status", found)
    with pytest.raises(NoStream, match="expected role/port or role/instance/port"):
        resolve("controller/lew/command", found)


def test_a_robot_without_answering_nodes_has_no_streams() -> None:
    with pytest.raises(NoStream, match="no stream 'gate/command': no node of the robot answers"):
        resolve("gate/command", listing(client(BusInWords([], silent=["gate main"]))))


def test_only_streams_for_late_joiners_are_queried() -> None:
    result = GoalResult(1, "succeeded", "the goal was reached", Point2D(1.0, 2.0))
    bus = BusInWords(everyone(), last={"goal/main/result": result})
    found = retained(client(bus), "goal/main/result")
    assert found is not None and found[0] == result and found[1].key == "lab/r1/goal/main/result"
    assert retained(client(bus), "goal/main/feedback") is None
    assert retained(client(bus), "platform/sim/odometry") is None
    assert bus.asked == ["lab/r1/goal/main/result", "lab/r1/goal/main/feedback"]


def test_a_stop_is_printed_as_the_text_of_version_1_and_as_its_reason() -> None:
    status = GateStatus("none", "", True, False, StopReason("stale", "controller law"), ())
    found = message_fields(status)
    assert found["reason"] == "stale: controller law"
    assert found["why"] == {"kind": "stale", "who": "controller law", "of": ""}
    assert list(found) == [
        "source", "instance", "stopped", "latched", "reason", "pending", "share", "limit", "place", "distance", "why",
    ]  # fmt: skip


def test_a_kept_message_that_cannot_be_read_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = BusInWords(everyone())
    refused, broken = (
        Answer("", b"", "", "Timeout"),
        Answer("lab/r1/mapper/grid/map", b"\x00", "navloom.MapUpdate/1", ""),
    )
    monkeypatch.setattr(bus, "ask", lambda *given, **more: iter([refused, broken]))
    assert retained(client(bus), "mapper/grid/map") is None


def test_messages_of_a_stream_are_queued_and_too_large_ones_counted() -> None:
    bus = BusInWords(everyone())
    taps = tap(client(bus), ["platform/sim/contact"], Mailbox())
    receive = bus.listeners["lab/r1/platform/sim/contact"]
    receive("lab/r1/platform/sim/contact", *wire(Contact(True), "platform/sim/contact"))
    receive("lab/r1/platform/sim/contact", None, "navloom.Contact/1")
    inlet = taps["platform/sim/contact"]
    assert [message for message, _ in inlet.take()] == [Contact(True)]
    assert (inlet.counts.malformed, inlet.counts.complaint) == (1, "it is too large to be copied")


# --- messages -------------------------------------------------------------------------------------------------------


def scan() -> RangeScan:
    zero = np.zeros(5)
    ranges = np.array([1.0, 2.0, 3.0, 4.0, math.inf])
    return RangeScan(7, np.zeros((5, 2)), zero, zero, zero, ranges, 0.1, 5.0)


def test_an_array_is_summarised_by_its_finite_entries() -> None:
    found = message_fields(scan())
    assert found["ranges"] == {
        "dtype": "float64", "shape": [5], "min": 1.0, "mean": 2.5, "max": 4.0, "infinite": 1,
        "first": [1.0, 2.0, 3.0, 4.0],
    }  # fmt: skip
    assert found["origins"]["shape"] == [5, 2] and found["origins"]["first"] == [0.0] * 4
    assert (found["stamp_ns"], found["range_max"]) == (7, 5.0)


def test_an_array_is_given_whole_on_request() -> None:
    found = message_fields(scan(), whole=True)
    assert found["ranges"] == [1.0, 2.0, 3.0, 4.0, math.inf]
    assert found["origins"] == [[0.0, 0.0]] * 5


def test_an_array_without_entries_has_no_minimum() -> None:
    empty = np.empty(0)
    found = message_fields(RangeScan(7, np.empty((0, 2)), empty, empty, empty, empty, 0.1, 5.0))
    assert found["ranges"] == {"dtype": "float64", "shape": [0], "first": []}


def test_messages_within_messages_and_envelopes_become_plain_values() -> None:
    result = GoalResult(1, "stuck", "trapped", Point2D(1.0, 2.0))
    assert message_fields(result)["place"] == {"x": 1.0, "y": 2.0}
    bus = BusInWords(everyone(), last={"goal/main/result": result})
    found = retained(client(bus), "goal/main/result")
    assert found is not None
    assert envelope_fields(found[1]) == {
        "key": KEYS.port("goal", "main", "result"), "sequence": 1, "tick": 1, "stamp_ns": 0, "cause_ns": 0, "epoch": 0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("x", "y", "words"),
    [(0.5, 0.0, "ahead"), (0.2, 0.4, "left (63°)"), (0.0, -0.5, "right (90°)"), (-0.5, 0.0, "behind")],
)
def test_the_obstacle_that_slows_the_robot_is_reported_with_its_place(x: float, y: float, words: str) -> None:
    slowed = GateStatus("controller", "law", False, False, None, (), 0.4, "obstacle", Point2D(x, y), 0.25)
    assert who_drives(slowed) == f"controller law drives, slowed: obstacle 0.25 m away, {words}"
    stopped = replace(slowed, stopped=True, why=StopReason("obstacle"), share=0.0)
    assert why_stopped(stopped)[0] == f"obstacle 0.25 m away, {words}"


def test_a_robot_without_room_to_turn_is_reported_with_what_is_beside_it_and_what_the_recovery_does() -> None:
    status = GateStatus(
        "controller", "law", True, False, StopReason("no_room"), (), 0.0, "obstacle", Point2D(-0.1, -0.3), 0.05
    )
    assert why_stopped(status) == (
        "no room to turn, obstacle 0.05 m away, right (108°)",
        "the recovery drives out and turns where there is room, after 2 s",
    )
