"""Abuse of a viewer's certificate, some kinds of it on one driving robot: nothing starts again, no goal is lost.

How often the robot stops meanwhile is measured by `abuse.py` (docs/abuse-campaigns.md); here other tests share the
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
"""Share of a processor that a process of the robot may take meanwhile, the router excepted."""


@pytest.mark.slow
def test_what_a_viewer_does_ends_no_process_and_no_goal_and_costs_the_robots_processes_little() -> None:
    with target() as aim:
        for kind in CHOSEN:
            found = trial(aim, kind, 3.0)
            assert found.is_harmless and not found.touched, found
            assert max(share for name, share in found.spent.items() if name != "router") < MOST, found


@pytest.mark.slow
def test_a_reader_that_takes_little_does_not_hold_up_what_the_processes_say_to_each_other() -> None:
    with target() as aim:
        trials = [trial(aim, "a slow reader", 2.0) for _ in range(5)]
    assert all(found.is_harmless for found in trials), trials
    assert max(found.stood for found in trials) < 0.2, trials  # up to 0.8 s in half of them, with one thread that sends


def test_every_kind_of_abuse_is_told_with_its_certificate() -> None:
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
