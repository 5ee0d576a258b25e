"""Some kinds of abuse of a viewer's certificate on one driving robot: no process restarts, no goal is lost.

`abuse.py` measures how often the robot stops meanwhile (docs/lab/abuse-campaigns.md); here other tests share the
processors.
"""

from __future__ import annotations

import pytest
from abuse import table, target, trial
from attacker import KINDS

CHOSEN = (
    "describe, 60 MB, twice",
    "describe, 100,000 times [",
    "memory, 1000 a second",
    "config, as fast as it goes",
    "20,000 subscribers to commands",
)
MOST = 0.5
"""Largest share of a processor that a process of the robot may use meanwhile, the router excluded."""


@pytest.mark.slow
def test_a_viewer_ends_no_process_and_no_goal_and_costs_the_robot_little_processor_time() -> None:
    with target() as aim:
        for kind in CHOSEN:
            found = trial(aim, kind, 3.0)
            assert found.is_harmless and not found.touched, found
            assert max(share for name, share in found.spent.items() if name != "router") < MOST, found


@pytest.mark.slow
def test_a_slow_reader_does_not_delay_messages_between_the_robots_processes() -> None:
    with target() as aim:
        trials = [trial(aim, "a slow reader", 2.0) for _ in range(5)]
    assert all(found.is_harmless for found in trials), trials
    assert max(found.stood for found in trials) < 0.2, trials  # with one sending thread: up to 0.8 s


def test_the_table_has_every_kind_of_abuse_with_its_certificate() -> None:
    entry = {
        "stops": 2,
        "stood": 0.5,
        "restarts": 0,
        "touched": False,
        "goal": "kept",
        "problem": "",
        "spent": {"safe": 0.1},
    }
    told = table([{"kind": kind, **entry} for kind in KINDS for _ in range(3)]).splitlines()
    assert len(told) == 2 + len(KINDS)
    assert told[2] == "| nothing | viewer | 3 | 3 | 6 | 0.50 | 0 | 0 | 0 | 0.10 | 0 |"
    assert {identity for identity, _ in KINDS.values()} == {"viewer", "shadow", "operator"}
    assert sum(identity == "viewer" for identity, _ in KINDS.values()) >= 30
