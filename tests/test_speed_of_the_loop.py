"""How much faster than real time the paper's closed loop runs in lockstep, viewer off."""

from __future__ import annotations

import pytest
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import lockstep_of
from navloom.engine.plugin_factory import make_plugins

LEAST = 30.0
"""Robot time over wall time, at 20 Hz: a guard against regressions, a quarter of what docs/lab/measurements.md has.
The target of 300 is not met there; the page says why."""


@pytest.mark.benchmark
def test_the_papers_loop_is_far_faster_than_real_time(benchmark) -> None:
    system = assemble(load_config("paper"))

    def fresh():
        make_plugins(system)
        return (lockstep_of(system),), {}

    log = benchmark.pedantic(lambda executor: executor.run(2000), setup=fresh, rounds=5)
    factor = log.ticks * system.config.run.period / benchmark.stats.stats.min
    benchmark.extra_info["real_time_factor"] = factor
    assert factor >= LEAST
