"""Improved VFH alone, without map or plan, on the simulated robot: clutter, a trap, and doorways.

The target is the goal itself; the gate's limits hold. Nothing else of the framework takes part.
"""

from __future__ import annotations

import math
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from navloom import AvoiderInput, Box, Place, PlatformInput, Point2D, Pose2D, PoseEstimate, RangeScan, Twist2D, World
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import gate_limits
from navloom.engine.plugin_factory import make_plugins
from navloom.navigation.command_gate import CommandGate, Offer, Sensed
from navloom.worlds.trial_worlds import clutter_world

PERIOD_NS = 50_000_000
NO_COVARIANCE = np.zeros((3, 3))


class Ending(NamedTuple):
    """Outcome of a drive, and its least clearance, m."""

    word: str
    gap: float


def drive(world: World, start: Place, goal: Place, seed: int, seconds: float = 180.0) -> Ending:
    """Drive the paper's robot on its sonars alone: reached, trapped, contact or timeout."""
    x, y, heading = start.x, start.y, math.degrees(start.heading)
    system = assemble(
        load_config(
            "paper",
            [
                f"run.seed={seed}",
                f"navigation.start={{x={x},y={y},heading_deg={heading}}}",
                'sensor=[{name="sonars",kind="sonar_ring"}]',
                'mapper={plugin="known_map"}',
                "avoider.plugin=improved_vfh",
            ],
        )
    )
    system.world = world
    make_plugins(system)
    platform, avoider = system.plugin("platform", "sensors_sim"), system.plugin("avoider", "improved_vfh")
    gate, twist, gap = CommandGate(gate_limits(system)), Twist2D(0.0, 0.0, 0.0), math.inf
    trapped = 0
    for tick in range(round(seconds * 1e9) // PERIOD_NS):
        now = tick * PERIOD_NS
        seen = platform.advance(PlatformInput(twist, None, now))  # type: ignore[attr-defined]
        assert seen.truth is not None
        gap = min(gap, seen.truth.clearance)
        pose = seen.truth.pose
        if seen.truth.touching:
            return Ending("contact", 0.0)
        if math.hypot(goal.x - pose.x, goal.y - pose.y) < 0.3:
            return Ending("reached", gap)
        scans = tuple(scan for scan in seen.scans.values() if isinstance(scan, RangeScan))
        estimate = PoseEstimate(now, Pose2D(pose.x, pose.y, pose.heading), seen.odometry.twist, NO_COVARIANCE)
        answer = avoider.avoid(  # type: ignore[attr-defined]
            AvoiderInput(now, scans, estimate, Point2D(goal.x, goal.y), 0.5, Twist2D(0.0, 0.0, 0.0), 0.0)
        )
        trapped = trapped + 1 if answer.status == "trapped" else 0
        if trapped > 20:
            return Ending("trapped", gap)
        offers: dict[str, Offer | None] = {"operator": Offer("vfh", answer.twist, now, 0)}
        twist, _, _ = gate.decide(Sensed(now, False, {}), offers, True, 0, ())
    return Ending("timeout", gap)


def field(seed: int) -> Ending:
    """Drive through a clutter field of 20 posts, from its front to the target behind it."""
    world = clutter_world(str(seed), Path())
    assert world.start is not None and world.goal is not None
    return drive(world, world.start, world.goal, seed)


def door(width: float, approach: int) -> Ending:
    """Drive through a doorway in a long wall, from a seeded place and heading."""
    stream = np.random.default_rng([approach, 17])
    wall = (
        Box("left of the door", (-8.0, -0.5 * width), (3.0, 3.2)),
        Box("right of the door", (0.5 * width, 8.0), (3.0, 3.2)),
    )
    world = World("door", wall, bounds=(-8.0, -3.0, 8.0, 9.0))
    start = Place(stream.uniform(-1.5, 1.5), stream.uniform(-0.5, 0.5), 0.5 * math.pi + stream.uniform(-0.5, 0.5))
    return drive(world, start, Place(0.0, 6.0), approach)


def trap(approach: int) -> Ending:
    """Drive towards a target behind a dead end of 3 m by 3 m."""
    from navloom.worlds.trial_worlds import u_trap

    stream = np.random.default_rng([approach, 18])
    start = Place(stream.uniform(-0.5, 0.5), 0.0, 0.5 * math.pi + stream.uniform(-0.3, 0.3))
    return drive(u_trap(), start, Place(0.0, 8.0), approach)


def test_a_few_fields_are_crossed_without_contact() -> None:
    endings = [field(seed) for seed in range(3)]
    assert [ending.word for ending in endings] == ["reached"] * 3


def test_a_wide_door_is_passed() -> None:
    assert door(1.8, 0).word == "reached"


def test_a_dead_end_is_reported_as_trapped() -> None:
    assert trap(0).word == "trapped"


def all_of(work: object, *columns: object) -> list[Ending]:
    with ProcessPoolExecutor(2) as pool:
        return list(pool.map(work, *columns, chunksize=5))  # type: ignore[arg-type]


@pytest.mark.slow
def test_at_least_45_of_50_fields_are_crossed_and_none_with_contact() -> None:
    endings = all_of(field, range(50))
    words = Counter(ending.word for ending in endings)
    print(f"fields: {dict(words)}, least gap {min(ending.gap for ending in endings):.3f} m")
    assert words["contact"] == 0
    assert words["reached"] >= 45 and words["reached"] + words["trapped"] == 50


@pytest.mark.slow
def test_doors_of_1_6_m_and_more_are_always_passed_and_none_is_touched() -> None:
    widths = [round(1.0 + 0.1 * k, 1) for k in range(15)]
    rows = [(width, approach) for width in widths for approach in range(20)]
    endings = all_of(door, [row[0] for row in rows], [row[1] for row in rows])
    curve = {w: [e.word for (width, _), e in zip(rows, endings, strict=True) if width == w] for w in widths}
    print("doors:", {w: dict(Counter(words)) for w, words in curve.items()})
    print(f"least gap {min(ending.gap for ending in endings):.3f} m")
    assert "contact" not in {ending.word for ending in endings}
    assert all(words == ["reached"] * 20 for w, words in curve.items() if w >= 1.6)


@pytest.mark.slow
def test_dead_ends_are_reported_as_trapped_and_never_touched() -> None:
    words = Counter(ending.word for ending in all_of(trap, range(20)))
    print("traps:", dict(words))
    assert words == {"trapped": 20}
