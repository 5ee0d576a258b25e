"""A recording from before the gate's status and the goal's result had codes is read, replayed and equal.

`version_1.mcap.gz` is a run of the toys, 0.35 m ahead with a stop and a resume; all its schemas have version 1.
"""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest
from navloom.engine.build import assemble
from navloom.messages import Feedback, GateStatus, GoalResult, Message, StopReason
from navloom_recording.reader import Recording
from navloom_recording.replay_check import check
from navloom_recording.step_replay import Replayer
from toys import discovery

FILE = Path(__file__).with_name("version_1.mcap.gz")


@pytest.fixture
def before(tmp_path: Path) -> Recording:
    path = tmp_path / "before.mcap"
    path.write_bytes(gzip.decompress(FILE.read_bytes()))
    return Recording(path)


def messages(recording: Recording, stream: str) -> list[Message]:
    return [record.open().message for record in recording.raw() if record.key == f"lab/r1/{stream}"]


def test_its_stops_have_kinds(before: Recording) -> None:
    said = messages(before, "gate/main/status")
    stops = [message.why for message in said if isinstance(message, GateStatus) and message.stopped]
    assert len(said) == 7
    assert stops == [StopReason("no_trajectory"), StopReason("operator"), StopReason("no_trajectory")]


def test_its_goal_succeeded(before: Recording) -> None:
    (result,) = messages(before, "goal/main/result")
    assert isinstance(result, GoalResult) and result.outcome == "succeeded"
    assert {message.state for message in messages(before, "goal/main/feedback") if isinstance(message, Feedback)} >= {
        "driving"
    }


def test_it_is_replayed_and_every_node_gives_what_it_gave_but_for_the_estimated_time(before: Recording) -> None:
    found = {one.node: one for one in check(Replayer(before, assemble(before.header.loaded(), discovery())))}
    gate, goal = found["gate main"], found["goal main"]
    assert (gate.steps, gate.messages) == (39, 47) and goal.messages > 0
    differing = [one.first for one in found.values() if one.first is not None]
    # The remaining time is estimated in another way since then.
    assert [(one.node, one.port, one.field) for one in differing] == [("goal main", "feedback", "time_left")]
