"""The viewer colours a sweep by the classes of the mapper `ipabd`: its counts by class equal the mapper's."""

from __future__ import annotations

import numpy as np
import pytest
from navloom.messages import Sweep
from navloom_ipabd.pressure import press
from navloom_ipabd.rules import Filters, Rule
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import frame_motion, standing
from navloom_viewer.picture_setup import SweepRule
from navloom_viewer.sweep_classes import CLASSES, classify_sweep, sweep_points

NONE = (Rule.NO_RETURN, Rule.BEYOND_MAX, Rule.BELOW_MIN)
OF_RULES = {
    "none": NONE,
    "below": (Rule.BELOW_FLOOR,),
    "floor": (Rule.FLOOR,),
    "overhead": (Rule.TOO_HIGH,),
    "behind": (Rule.NOT_MINIMUM,),
    "kept": (Rule.KEPT,),
}


def random_sweep(geometry: str) -> Sweep:
    """60 frames of 91 beams with random ranges: floor, ceiling, dust, no return."""
    rng = np.random.default_rng(4)
    ranges = rng.uniform(0.0, 9.0, (60, 91))
    ranges[rng.random((60, 91)) < 0.1] = np.inf
    pitches, bearings = np.radians(np.linspace(-40.0, 30.0, 60)), np.radians(np.linspace(-90.0, 90.0, 91))
    times = np.linspace(0.0, 1.0, 60)
    return Sweep(0, 1, ranges, pitches, times, bearings, geometry, 0.1, 0.05, 0.4, 0.2, 8.0)  # type: ignore[arg-type]


def counted(sweep: Sweep, rule: SweepRule, poses: np.ndarray | None = None) -> dict[str, int]:
    numbers = np.bincount(classify_sweep(sweep, rule, poses).ravel(), minlength=len(CLASSES))
    return dict(zip(CLASSES, numbers.tolist(), strict=True))


def image_of(sweep: Sweep) -> SweepImage:
    mount = (sweep.x, sweep.y, sweep.z)
    return SweepImage(
        sweep.ranges, sweep.pitches, sweep.frame_times, sweep.bearings, mount, sweep.range_min, sweep.range_max,
        sweep.geometry,
    )  # fmt: skip


@pytest.mark.parametrize("order", ["before_min", "paper"])
@pytest.mark.parametrize("geometry", ["paper", "rigid_pitch"])
def test_counts_equal_the_mappers(geometry: str, order: str) -> None:
    sweep = random_sweep(geometry)
    found = press(image_of(sweep), Filters(order=order), standing(60, (0.0, 0.0, 0.0)))  # type: ignore[arg-type]
    expected = {name: sum(found.counts[rule] for rule in rules) for name, rules in OF_RULES.items()}
    assert counted(sweep, SweepRule(minimum_first=order == "paper"), np.zeros((60, 3))) == expected


def test_counts_equal_the_mappers_while_the_robot_moves() -> None:
    sweep = random_sweep("paper")
    poses = np.column_stack([sweep.frame_times * 0.4, sweep.frame_times * 0.1, sweep.frame_times * 0.3])
    stamps = np.round(sweep.frame_times * 1e9).astype(np.int64)
    motion = frame_motion(0, sweep.frame_times, (sweep.x, sweep.y), stamps, poses, slack=0.0)
    found = press(image_of(sweep), Filters(), motion)
    expected = {name: sum(found.counts[rule] for rule in rules) for name, rules in OF_RULES.items()}
    assert counted(sweep, SweepRule(), poses) == expected


def test_a_point_lies_where_trigonometry_puts_it() -> None:
    pitch, zero = np.array([-np.pi / 6]), np.zeros(1)
    down = Sweep(0, 1, np.array([[2.0]]), pitch, zero, zero, "paper", 0.1, 0.0, 1.0, 0.0, 9.0)
    (point,) = sweep_points(down, SweepRule(), np.array([[1.0, 2.0, np.pi / 2]]))[0]
    # 2 m at 30 degrees down from 1 m: on the floor, 1.732 m ahead of the sensor, which is 0.1 m ahead of base.
    assert point == pytest.approx([1.0, 2.0 + 0.1 + 1.7320508, 0.0], abs=1e-6)
    assert CLASSES[int(classify_sweep(down, SweepRule())[0, 0])] == "floor"
