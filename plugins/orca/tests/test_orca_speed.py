"""Speed as ratios within one run."""

import time

import numpy as np
import pytest
from navloom.geometry.actors import Actor, Body, Walk
from navloom.geometry.moving_world import MovingWorld
from navloom.geometry.world import World
from navloom_orca.crowd import Reaction, react
from orca_scenes import crowd_of
from test_orca_avoidance import PERIOD, bodies, given, laser, method_of


def spent(step, times=200):
    """(times,) CPU time of each call, ms, after 10 others."""
    ticks = []
    for k in range(times + 10):
        begin = time.process_time()
        step(k)
        ticks.append(time.process_time() - begin)
    return 1e3 * np.array(ticks[10:])


@pytest.mark.benchmark
def test_four_times_the_crowd_costs_less_than_eight_times_as_much(benchmark):
    """400 agents in 20 x 20 m, 1600 in 40 x 40 m: cells find neighbours, so the cost grows with the number."""

    def of(count, size):
        crowd, sees = crowd_of(np.random.default_rng(1), count, size, None), np.ones((count, count), bool)
        return spent(lambda k: react(*crowd, sees, reaction=Reaction(reach=3.0)))

    of(400, 10.0)
    few, many = of(400, 10.0), benchmark.pedantic(of, (1600, 20.0), rounds=1)
    benchmark.extra_info |= {"cpu_ms_p50_at_400": np.median(few), "cpu_ms_p50_at_1600": np.median(many)}
    benchmark.extra_info["cpu_ms_p50_at_100"] = np.median(of(100, 5.0))
    assert np.median(many) < 8.0 * np.median(few)


@pytest.mark.benchmark
def test_a_world_of_100_actors_costs_less_than_four_times_their_law(benchmark):
    """Goals, walking, bodies and the message take no longer than what the law needs, with room for noise."""
    rng, side, laws = np.random.default_rng(3), 22.0, []
    starts = [
        (x, y) for x in np.linspace(1.0, side - 1.0, 10).tolist() for y in np.linspace(1.0, side - 1.0, 10).tolist()
    ]
    goals = [tuple((x, y) for x, y in rng.uniform(1.0, side - 1.0, (20, 2)).tolist()) for _ in starts]
    actors = tuple(
        Actor(f"person {k}", Walk(start, way, loops=True), Body("legs", 0.44, 0.44))
        for k, (start, way) in enumerate(zip(starts, goals, strict=True))
    )

    def law(*given):
        begin = time.process_time()
        found = react(*given, reaction=Reaction(period=PERIOD))
        laws.append(1e3 * (time.process_time() - begin))
        return found

    world = MovingWorld(World("w", actors=actors), (), PERIOD, law)
    ticks = benchmark.pedantic(spent, (lambda k: world.advance(round(k * PERIOD * 1e9), ()), 400), rounds=1)
    benchmark.extra_info |= {"cpu_ms_p50": np.median(ticks), "cpu_ms_p50_of_the_law": np.median(laws)}
    assert np.median(ticks) < 4.0 * np.median(laws)


@pytest.mark.benchmark
def test_a_tick_with_ten_tracks_costs_less_than_a_tenth_of_the_period(benchmark):
    """A laser of 360 beams among 60 posts, and ten people who walk."""
    rng = np.random.default_rng(2)
    posts = rng.uniform(-5.0, 5.0, (60, 2))
    posts = posts[np.hypot(*posts.T) > 0.9].tolist()
    people = bodies(*np.column_stack([rng.uniform(-5.0, 5.0, (10, 2)), rng.uniform(-1.0, 1.0, (10, 2))]))
    method, scan = method_of(), laser(posts)
    ticks = benchmark.pedantic(
        spent, (lambda k: method.step([scan], None, given(twist=(0.5, 0.0), tracks=people, time=PERIOD * k)),), rounds=1
    )
    benchmark.extra_info |= {"cpu_ms_p50": np.median(ticks), "cpu_ms_p99": np.percentile(ticks, 99)}
    assert np.median(ticks) < 100.0 * PERIOD
