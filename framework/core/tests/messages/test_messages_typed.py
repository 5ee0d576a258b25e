"""Messages that the compiled reader reads, and those that it leaves to the generic one."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest
from navloom.messages import (
    AvoiderStatus,
    Envelope,
    GateStatus,
    InputRead,
    MapUpdate,
    Message,
    OccupancyGrid,
    Path,
    Point2D,
    PortMark,
    Pose2D,
    PoseTrack,
    RangeScan,
    Selection,
    StepReport,
    StopReason,
    Trajectory,
    Truth,
    Twist2D,
    codec,
)
from navloom.messages.arrays import FORMS, recalling
from navloom.messages.codec import CodecError, decode, encode, schema_label
from navloom.messages.typed import _Reader

AT = Envelope("lab/r1/localizer/main/pose", 3, 4, 200_000_000, 150_000_000, 0)
ORIGIN = Pose2D(0.0, 0.0, 0.0)
BEAMS = np.linspace(0.1, 1.0, 8)
SCAN = RangeScan(5, np.zeros((8, 2)), BEAMS, BEAMS, BEAMS, np.append(BEAMS[:-1], np.inf), 0.0, 5.0)
GRID = OccupancyGrid(np.array([[-1, 100], [0, 7]], np.int8), 0.1, ORIGIN)
TRACK = PoseTrack(np.array([10, 20]), np.arange(6.0).reshape(2, 3))
REPORT = StepReport(
    "tick", (InputRead("scans", (7, 8)), InputRead("map", ())), (PortMark("pose", 4),), True, 0, 1, 123, "é" * 9
)
PLAIN = [
    Point2D(-0.0, 5e-324),
    Truth(ORIGIN, Twist2D(0.1, 0.0, -0.2), float("inf"), "wall", False),
    GateStatus("avoider", "forces", False, False, None, ("mapper b",), 0.5, "obstacle", Point2D(1.0, 2.0), 0.3),
    GateStatus("none", "", True, True, StopReason("operator"), ()),
    Selection(1, 2, ("mapper a", "planner b")),
    REPORT,
    SCAN,
    TRACK,
    MapUpdate(9, GRID, np.zeros((0, 4)), ()),
    Path(1, np.ones((3, 2)), 2.0, None),
    AvoiderStatus("clear", None),
]


def changed(data: bytes, change: Callable[[Any], None]) -> bytes:
    (length,) = struct.unpack_from("<I", data)
    header = msgpack.unpackb(data[4 : 4 + length])
    change(header)
    packed, tail = msgpack.packb(header), data[4 + length + -(4 + length) % 64 :]
    head = struct.pack("<I", len(packed)) + packed
    return head + (bytes(-len(head) % 64) + tail if tail else b"")


@pytest.mark.parametrize("given", PLAIN, ids=lambda given: type(given).__name__)
def test_messages_of_this_version_are_read_without_the_generic_reader(
    given: Message, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(codec, "_header", None)
    back, at = decode(encode(given, AT), schema_label(type(given)))
    assert (type(back), type(at), at) == (type(given), Envelope, AT)
    assert encode(back, at) == encode(given, AT)


def test_a_nested_message_that_may_hold_arrays_is_left_to_the_generic_reader() -> None:
    back, _ = decode(encode(Path(1, np.ones((3, 2)), 2.0, GRID), AT), "navloom.Path/1")
    assert isinstance(back, Path) and back.traversable is not None
    assert back.traversable.cells.tolist() == GRID.cells.tolist()


def test_a_whole_number_in_a_field_of_floats_is_held_as_a_float() -> None:
    back, _ = decode(changed(encode(Point2D(3.0, 0.5), AT), lambda h: h["fields"].update(x=3)), "navloom.Point2D/1")
    assert isinstance(back, Point2D) and type(back.x) is float and back.x == 3.0


@pytest.mark.parametrize("name", ["é" * 127, "x" * 255])
def test_a_name_is_bounded_by_its_bytes_and_not_by_its_characters(name: str) -> None:
    report = StepReport(name, (), (), True, 0, 0, 0, "")
    assert decode(encode(report, AT), "navloom.StepReport/1")[0] == report
    longer = changed(encode(report, AT), lambda h: h["fields"].update(trigger=name + "é"))
    with pytest.raises(CodecError, match=r"StepReport\.trigger: got a text of 25[67] bytes, expected at most 255"):
        decode(longer, "navloom.StepReport/1")


# --- a table of arrays is checked once, the arrays each time ---------------------------------------------------------


def test_a_table_that_was_seen_before_does_not_excuse_bytes_that_are_cut_short() -> None:
    data = encode(TRACK, AT)
    decode(data, "navloom.PoseTrack/1")
    expected = f"expected it at a multiple of 64 within the {len(data) - 1} bytes given"
    with pytest.raises(CodecError, match=expected):
        decode(data[:-1], "navloom.PoseTrack/1")


@pytest.mark.parametrize("bad", [np.nan, -np.inf, -1.0])
def test_a_table_that_was_seen_before_does_not_excuse_what_an_array_holds(bad: float) -> None:
    data = encode(SCAN, AT)
    decode(data, "navloom.RangeScan/1")
    with pytest.raises(CodecError, match=r"RangeScan\.ranges: holds "):
        decode(data[:-8] + struct.pack("<d", bad), "navloom.RangeScan/1")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_bad_values_are_refused_after_good_ones_of_the_same_shape(bad: float) -> None:
    data = encode(SCAN, AT)
    decode(data, "navloom.RangeScan/1")
    start = data.index(SCAN.bearings.tobytes())
    with pytest.raises(CodecError, match=r"RangeScan\.bearings: holds (nan|-?inf), expected finite numbers"):
        decode(data[:start] + struct.pack("<d", bad) + data[start + 8 :], "navloom.RangeScan/1")


def test_arrays_that_do_not_change_are_held_once_and_without_the_rest_of_their_message() -> None:
    first, second, third = (
        decode(encode(replace(SCAN, stamp_ns=stamp, ranges=ranges), AT), "navloom.RangeScan/1")[0]
        for stamp, ranges in ((5, BEAMS + 1.0), (6, BEAMS + 2.0), (7, BEAMS + 2.0))
    )
    assert isinstance(first, RangeScan) and isinstance(second, RangeScan) and isinstance(third, RangeScan)
    assert second.bearings is third.bearings and second.origins is third.origins
    assert second.bearings.base == BEAMS.tobytes() and not second.bearings.flags.writeable
    assert first.ranges.tolist() == (BEAMS + 1.0).tolist() and second.ranges.tolist() == (BEAMS + 2.0).tolist()


def test_changing_bearings_are_read_as_sent() -> None:
    for turn in (*range(40), 3, 3, 4):  # more often than arrays are compared
        scan = replace(SCAN, bearings=BEAMS + turn)
        back, _ = decode(encode(scan, AT), "navloom.RangeScan/1")
        assert isinstance(back, RangeScan) and back.bearings.tolist() == (BEAMS + turn).tolist()


def test_two_sensors_of_one_type_are_both_known_again() -> None:
    refused: list[int] = []
    view = recalling(np.dtype("float64"), lambda array: refused.append(array.size))
    front, rear = BEAMS.tobytes(), (BEAMS + 1.0).tobytes()
    for _ in range(40):
        assert view((8,), front, 0).tobytes() == front and view((8,), rear, 0).tobytes() == rear
        assert view((8,), np.frombuffer(rear, np.uint8), 0).tobytes() == rear  # of other memory: checked each time
    assert len(refused) == 2 + 40


def test_shapes_that_are_compared_are_bounded() -> None:
    refused: list[int] = []
    view = recalling(np.dtype("float64"), lambda array: refused.append(array.size))
    for count in (*range(1, 100), *range(1, 100)):
        data = np.arange(count, dtype=float).tobytes()
        assert view((count,), data, 0).tolist() == list(range(count))
    assert len(refused) == 2 * 99 - FORMS


def test_arrays_of_other_sizes_than_their_message_agrees_on_are_refused_each_time() -> None:
    data = changed(encode(TRACK, AT), lambda h: h["arrays"].__setitem__(0, ["<i8", [1], 0]))
    for _ in range(2):
        with pytest.raises(CodecError, match=r"PoseTrack\.poses: got shape \(2, 3\), expected"):
            decode(data, "navloom.PoseTrack/1")


def test_an_array_that_is_named_twice_is_held_twice() -> None:
    data = changed(encode(SCAN, AT), lambda h: h["fields"].update(half_angles=1))
    back, _ = decode(data, "navloom.RangeScan/1")
    assert isinstance(back, RangeScan) and back.half_angles.tolist() == back.bearings.tolist() == BEAMS.tolist()


def test_tables_that_are_kept_are_bounded() -> None:
    reader = _Reader(Trajectory)
    read = reader.compiled()
    for count in range(1, 400):
        data = encode(Trajectory(1, np.zeros((count, 6))), AT)
        (length,) = struct.unpack_from("<I", data)
        message, _ = read(data[4 : 4 + length], data, 4 + length + -(4 + length) % 64)
        assert isinstance(message, Trajectory) and message.samples.shape == (count, 6)
    assert 0 < len(reader.tables) <= 256
