"""What executors tell goal, gate and localizer, as step records store it: older recordings have the same words."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from navloom.engine.nodes.executor_inputs import (
    GateTold,
    GoalTold,
    LocalizerTold,
    Obeyed,
    gone_of,
    gone_text,
    place_of,
)
from navloom.messages import Goal, OperatorRequest, Point2D, StopReason


def test_a_request_to_the_goal_survives_a_round_trip() -> None:
    goal = Goal(3, 1.0, 2.0, None, (Point2D(0.5, 0.5),))
    told = GoalTold("broke", True, ("mapper",), (OperatorRequest("goal", goal), OperatorRequest("cancel")))
    assert GoalTold.of(told.text) == told
    assert GoalTold().text == "" and GoalTold.of("") == GoalTold()


def test_the_words_of_a_goal_are_those_of_older_recordings() -> None:
    old = '{"fault": "", "lost": true, "restarted": ["planner"], "submitted": [{"do": "cancel", "goal": null}]}'
    assert GoalTold.of(old).text == old


def test_the_words_of_a_gate_are_those_of_older_recordings() -> None:
    old = (
        '{"now_ns": 5, "silent": true, "gone": "controller x", '
        '"obeyed": [{"do": "stop", "role": "", "instance": "", "driving": 7}], "contact": true, "warm": ["avoider b"]}'
    )
    assert GateTold.of(old).text == old
    assert GateTold.of(old).obeyed == (Obeyed("stop", "", "", 7),)


def test_only_fields_that_differ_from_the_default_are_written() -> None:
    assert GateTold(warm=("avoider b",)).text == '{"warm": ["avoider b"]}'
    assert GateTold.of(GateTold(now_ns=5, late="goal main").text).late == "goal main" and not GateTold.of("{}").late
    assert GateTold(now_ns=5, speed_limit=0.25).text == '{"now_ns": 5, "speed_limit": 0.25}'
    assert GateTold(now_ns=5, restarted=True).text == '{"now_ns": 5, "restarted": true}'
    assert GateTold().text == "" and GateTold(now_ns=0).text == "{}" and GateTold.of("{}").now_ns is None


def test_a_record_of_a_later_version_may_have_more_entries() -> None:
    assert GateTold.of('{"now_ns": 5, "gear": 2, "obeyed": []}') == GateTold(now_ns=5)
    assert GoalTold.of('{"fault": "broke", "speed": 0.5}') == GoalTold("broke")


@pytest.mark.parametrize("read", [GoalTold.of, GateTold.of])
def test_a_record_with_an_entry_of_another_type_names_it(read: Callable[[str], object]) -> None:
    entry = "lost" if read == GoalTold.of else "silent"
    with pytest.raises(ValueError, match=f"^{entry}: expected bool, got str$"):
        read(json.dumps({entry: "yes"}))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", None),
        ("localizer odometry", StopReason("gone", "localizer odometry")),
        ("goal main does not step", StopReason("goal_halted")),
        (
            "rivals: controller main on host a (process 1)",
            StopReason("rivals", "controller main", "on host a (process 1)"),
        ),
    ],
)
def test_a_missing_node_is_written_as_in_older_recordings(text: str, reason: StopReason | None) -> None:
    assert (gone_of(text), gone_text(reason)) == (reason, text)


def test_what_a_localizer_was_told_comes_back_as_the_same_requests() -> None:
    pose = Goal(0, 1.0, -2.0, 0.5, ())
    asked = (
        OperatorRequest("place", pose),
        OperatorRequest("place", pose, spread=0.7, heading_spread=0.25),
        OperatorRequest("relocalise"),
    )
    text = LocalizerTold(tuple(map(place_of, asked))).text
    assert tuple(LocalizerTold.of(text).requests) == asked
    assert LocalizerTold().text == "" and not LocalizerTold.of("").places
