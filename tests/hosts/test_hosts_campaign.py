"""Every network fault many times: takes minutes, so only with `-m slow`."""

from __future__ import annotations

import pytest
from host_campaign import FAULTS, campaign, table
from host_rig import why_not
from wall_clocks import why_no_clocks

WITHOUT = why_not() or why_no_clocks()
TIMES = 20
WANTED = 0.150
"""Longest time that motors may run on after the last good command, s."""


@pytest.mark.slow
@pytest.mark.skipif(bool(WITHOUT), reason=WITHOUT or "hosts can be made")
def test_motors_stop_in_time_at_every_network_fault_and_goals_succeed() -> None:
    with campaign() as running:
        outcomes = {name: [running.inject(name) for _ in range(TIMES)] for name in FAULTS}
    print(table(outcomes))
    for name, outcome in outcomes.items():
        assert max(one.fault.ran_on for one in outcome) <= WANTED, name
        assert not any(one.touched for one in outcome), name
        assert not [text for one in outcome for text in one.ended if not text.startswith("succeeded")], name
        if name.startswith("cut") or name == "router killed":
            assert all(one.fault.stopped is not None for one in outcome), name
