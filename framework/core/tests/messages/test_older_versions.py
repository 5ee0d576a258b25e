"""Older versions of messages: their bytes decode as the present one, which can still be had as it was."""

from __future__ import annotations

import numpy as np
import pytest
from navloom.messages import (
    SCHEMAS,
    Envelope,
    Feedback,
    GateStatus,
    Goal,
    GoalResult,
    Message,
    MessageError,
    OperatorRequest,
    Path,
    PlanRequest,
    Point2D,
    Pose2D,
    Reference,
    StopReason,
    Words,
    message,
)
from navloom.messages.codec import UnknownSchema, decode, encode, schema_label
from navloom.messages.goals import Feedback1, GoalResult1, OperatorRequest1
from navloom.messages.mapping import Path1, PlanRequest1
from navloom.messages.motion import GateStatus1, Reference1
from navloom.messages.schema import OLDER, in_version
from navloom.plugins.message_opening import Opener

AT = Envelope("lab/r1/gate/main/status", 7, 3, 150_000_000, 100_000_000, 1)
PLACE = Point2D(1.0, 2.0)
STALE = StopReason("stale", "controller law")
POSE = Pose2D(1.0, 2.0, 0.5)
HERE = Goal(0, 1.0, 2.0, 0.5, ())
PAIRS = [
    (
        GateStatus1("none", "", True, False, "stale: controller law", ("mapper b",), 0.3, "obstacle", PLACE, 0.5),
        GateStatus("none", "", True, False, STALE, ("mapper b",), 0.3, "obstacle", PLACE, 0.5),
    ),
    (GateStatus1("avoider", "vfh", False, False, "", ()), GateStatus("avoider", "vfh", False, False, None, ())),
    (Feedback1(1, "recovering", 0.5, 2.0, 0.1, 1, "lost: x"), Feedback(1, "recovering", 0.5, 2.0, 0.1, 1, "lost: x")),
    (GoalResult1(1, "stuck", "trapped", PLACE), GoalResult(1, "stuck", "trapped", PLACE)),
    (OperatorRequest1("place", HERE), OperatorRequest("place", HERE)),
    (PlanRequest1(1, POSE, POSE), PlanRequest(1, POSE, POSE)),
]


@pytest.mark.parametrize(("older", "present"), PAIRS)
def test_bytes_of_an_older_version_decode_as_the_present_message(older: Message, present: Message) -> None:
    assert decode(encode(older, AT), schema_label(type(older))) == (present, AT)


@pytest.mark.parametrize(("older", "present"), PAIRS)
def test_a_message_in_an_older_version_has_the_bytes_of_that_version(older: Message, present: Message) -> None:
    assert encode(in_version(present, schema_label(type(older))), AT) == encode(older, AT)


def test_an_older_path_has_no_headings() -> None:
    data = encode(Path1(3, np.array([[1.0, 2.0], [3.0, 4.0]]), 2.9, None), AT)
    path, _ = decode(data, "navloom.Path/1")
    assert isinstance(path, Path) and path.headings is None and path.points.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert encode(in_version(path, "navloom.Path/1"), AT) == data


def test_an_older_reference_drives_straight_ahead() -> None:
    data = encode(Reference1(1, 0.5, 2.0, POSE, 0.4, 0.1, 0.0, PLACE, np.zeros((1, 2)), 0.3), AT)
    reference, _ = decode(data, "navloom.Reference/1")
    assert isinstance(reference, Reference) and (reference.speed, reference.lateral_speed) == (0.4, 0.0)
    assert encode(in_version(reference, "navloom.Reference/1"), AT) == data


def test_the_code_is_left_out_in_the_older_version() -> None:
    assert in_version(GoalResult(1, "stuck", "trapped", PLACE, "trapped"), "navloom.GoalResult/1") == PAIRS[3][0]


def test_a_message_in_its_own_version_is_itself() -> None:
    status = PAIRS[0][1]
    assert in_version(status, schema_label(GateStatus)) is status


def test_the_general_reader_upgrades_too() -> None:
    pending = tuple(f"mapper {number:0>200}" for number in range(20))
    data = encode(GateStatus1("none", "", True, False, "x" * 900, pending), AT)
    assert len(data) > 4096  # beyond which the fast reader does not read
    status, _ = decode(data, "navloom.GateStatus/1")
    assert isinstance(status, GateStatus) and status.why == StopReason("other", "x" * 900)


def test_a_version_that_is_not_declared_is_refused() -> None:
    with pytest.raises(UnknownSchema, match="this side speaks version 2"):
        decode(encode(PAIRS[0][1], AT), "navloom.GateStatus/3")


def test_a_kind_that_is_unknown_is_refused() -> None:
    with pytest.raises(MessageError, match=r"StopReason\.kind: got 'wind', expected one of operator, contact"):
        StopReason("wind")  # type: ignore[arg-type]


def test_an_older_version_of_a_distributions_message_is_opened_too() -> None:
    @message(2)
    class Wind(Message):
        speed: float

        @property
        def knots(self) -> float:
            return self.speed * 2.0

    @message(1, now=Wind)
    class Wind1(Message):
        knots: float

        def upgraded(self) -> Wind:
            return Wind(self.knots / 2.0)

    try:
        assert Opener().open(encode(Wind1(6.0), AT), schema_label(Wind1))[0] == Wind(3.0)
    finally:
        del SCHEMAS[Wind.schema_name], OLDER[schema_label(Wind1)]


def test_an_older_version_that_cannot_be_upgraded_is_refused() -> None:
    with pytest.raises(TypeError, match="a version below 2 and a method `upgraded`"):

        @message(1, now=GateStatus)
        class Status1(Message):
            reason: Words


def test_an_older_field_that_the_present_message_does_not_have_is_refused() -> None:
    with pytest.raises(TypeError, match="version 1 has 'colour': give it a property"):

        @message(1, now=GateStatus)
        class Status1(Message):
            colour: Words

            def upgraded(self) -> GateStatus:
                return GateStatus("none", "", True, False, None, ())
