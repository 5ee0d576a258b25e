"""Speed as ratios within one run."""

import time

import numpy as np
import pytest
from mppi_scenes import laser, line, method_of
from navloom_mppi.control import Given

POSTS = np.random.default_rng(1).uniform(-5.0, 5.0, (60, 2))
POSTS = POSTS[np.hypot(POSTS[:, 0], POSTS[:, 1]) > 0.9].tolist()


def spent(samples):
    """(200,) CPU time of each tick, s, of a Jackal at 1 m/s among posts, with a laser of 360 beams."""
    method, path, ticks = method_of(samples=samples), line(8.0, 0.0), []
    for k in range(210):
        x = 0.02 * k
        given = Given(0.05 * k, (x, 0.0, 0.0), (1.0, 0.0), path[int(0.4 * k) :])
        scan = laser(POSTS, given.pose)
        begin = time.process_time()
        method.step([scan], None, given)
        ticks.append(time.process_time() - begin)
    return 1e3 * np.array(ticks[10:])


@pytest.mark.benchmark
def test_four_times_the_roll_outs_cost_less_than_four_times_as_much(benchmark):
    """Measured in CPU time, as the machine may be shared."""
    spent(500)
    few, many = spent(500), benchmark.pedantic(spent, (2000,), rounds=1)
    for name, ticks in (("500", few), ("2000", many)):
        median, p99 = np.percentile(ticks, [50, 99])
        benchmark.extra_info |= {f"cpu_ms_p50_at_{name}": median, f"cpu_ms_p99_at_{name}": p99}
    assert np.median(many) < 4.0 * np.median(few)
