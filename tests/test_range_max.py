"""A reading of `range_max` or more is no echo, for every plugin that reads scans: answers are those for +inf."""

from __future__ import annotations

import math

import pytest
from navloom import Context, Discovery, Point2D, Pose2D, RobotSpec
from navloom.config import check_params
from navloom.engine.random_streams import stream_source
from navloom.geometry.footprints import rectangle
from navloom.roles import AvoiderInput
from navloom.testing import messages

ROBOT = RobotSpec(rectangle(0.4, 0.4), 0.6, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)
SCANS = {"sonars": (0.26, 9, 0.8), "laser": (0.0, 181, 1.5)}
"""Half angle, rad, number of beams and range_max, m: near enough for avoiders to act."""


def plugin(role: str, name: str) -> object:
    cls = Discovery().role(role, name)
    cls.warm_up()
    context = Context("run", 0.05, ROBOT, stream_source(0, role, name), Pose2D(0.0, 0.0, 0.0))
    return cls(check_params(cls.Params, {}, "--set"), context)


def scan(kind: str, reading: float, stamp: float) -> object:
    half_angle, beams, range_max = SCANS[kind]
    return messages.scan(reading, beams=beams, field_of_view=math.pi, half_angle=half_angle, range_max=range_max,
                         stamp=stamp)  # fmt: skip


@pytest.mark.parametrize("kind", SCANS)
@pytest.mark.parametrize("name", ["dwa", "improved_vfh", "vff", "vfh", "vfh_plus", "vfh_star", "vfh_swept"])
def test_no_avoider_steers_round_the_end_of_its_sensors(name: str, kind: str) -> None:
    driven = []
    for reading in (math.inf, SCANS[kind][2], 1.1 * SCANS[kind][2]):
        avoider = plugin("avoider", name)
        for tick in range(1, 21):
            heard, at = scan(kind, reading, 0.05 * tick), messages.estimate(stamp=0.05 * tick)
            twist = messages.estimate(moving=(0.3, 0.0)).twist
            given = AvoiderInput(heard.stamp_ns, (heard,), at, Point2D(1.2, 0.0), 0.25, twist, 3.0, sensors=("s",))
            answer = avoider.avoid(given)
        driven.append((answer.status, answer.twist))
    assert driven[1:] == driven[:1] * 2
