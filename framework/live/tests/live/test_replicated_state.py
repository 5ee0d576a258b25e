"""State that survives a process: learnt from messages, passed on, and the newer of two versions wins."""

from __future__ import annotations

import pytest
from navloom.messages import Envelope, Feedback, GateStatus, Parameters, Selection, StopReason
from navloom_live.live.replicated_state import Memory

GATE, GOAL, CONTROLLER = ("gate", "main"), ("goal", "main"), ("controller", "law")


def at(tick: int) -> Envelope:
    return Envelope("k", tick, tick, 0, 0, 0)


def stop(reason: str, latched: bool) -> GateStatus:
    return GateStatus("none", "", True, latched, StopReason.parse(reason), ())


def full() -> Memory:
    memory = Memory()
    memory.note(GATE, Selection(3, 40, ("avoider other", "mapper m")), at(39))
    memory.note(GATE, stop("operator", True), at(50))
    memory.note(GOAL, Feedback(7, "driving", 1.0, 2.0, 0.0, 0), at(60))
    memory.note(CONTROLLER, Parameters(2, ("k1 = 2.0", "k3 = 1.0")), at(61))
    return memory


def test_another_process_learns_the_whole_state() -> None:
    learnt = Memory()
    learnt.learn(full().to_bytes())
    assert learnt == full()
    assert learnt.parameters == {"controller law": (2, ("k1 = 2.0", "k3 = 1.0"))}


def test_a_resumed_stop_is_not_kept() -> None:
    memory = full()
    memory.note(GATE, stop("no_trajectory", False), at(70))
    learnt = full()
    learnt.learn(memory.to_bytes())
    assert learnt.stop == (70, "")


@pytest.mark.parametrize(
    ("last", "kept"),
    [
        (stop("contact", True), "contact"),
        (GateStatus("none", "", True, False, StopReason.parse("stale: operator main"), ()), "stale: operator main"),
        (GateStatus("none", "", True, False, StopReason.parse("stale: controller law"), ()), ""),
        (GateStatus("controller", "law", False, False, None, ()), ""),
    ],
    ids=["contact", "operator-lost", "controller-late", "drives"],
)
def test_the_last_status_of_a_gate_that_ends_does_not_hide_a_stop_before_it(last: GateStatus, kept: str) -> None:
    memory = Memory()
    memory.note(GATE, last, at(50))
    memory.note(GATE, stop("ending", last.latched), at(51))
    assert memory.stop == (51, kept)


def test_a_stop_that_only_the_last_status_reports_is_kept() -> None:
    memory = Memory()
    memory.note(GATE, stop("ending", True), at(9))
    assert memory.stop == (9, "operator")


@pytest.mark.parametrize("reason", ["silent: platform", "silent: sensor sonars"])
def test_a_stop_for_a_silent_source_does_not_replace_that_for_a_stale_operator(reason: str) -> None:
    memory = Memory()
    memory.note(GATE, stop("stale: operator main", False), at(8))
    memory.note(GATE, stop(reason, False), at(9))
    assert memory.stop == (9, "stale: operator main")
    memory.note(GATE, stop("no_trajectory", False), at(10))
    assert memory.stop == (10, "")


def test_the_latest_run_clock_is_learnt() -> None:
    memory, other = Memory(clock_ns=5), Memory(clock_ns=70)
    memory.learn(other.to_bytes())
    other.learn(Memory().to_bytes())
    assert memory.clock_ns == other.clock_ns == 70


def test_an_older_state_changes_nothing() -> None:
    old = Memory()
    old.note(GATE, Selection(1, 5, ("avoider first",)), at(4))
    old.note(GOAL, Feedback(2, "driving", 1.0, 2.0, 0.0, 0), at(10))
    learnt = full()
    learnt.learn(old.to_bytes())
    assert learnt == full()


@pytest.mark.parametrize("data", [b"", b"null", b"[]", b'{"epoch": 9}', b"\xff\xfe"], ids=range(5))
def test_invalid_state_is_ignored(data: bytes) -> None:
    memory = full()
    memory.learn(data)
    assert memory.epoch in (3, 9) and memory.goal == full().goal
