"""Messages read again and again: that one was fine excuses nothing in the next."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest
from navloom.messages import (
    Envelope,
    OccupancyGrid,
    Path,
    Point2D,
    Pose2D,
    PoseTrack,
    RangeScan,
    StepReport,
)
from navloom.messages.codec import CodecError, decode, encode

AT = Envelope("lab/r1/localizer/main/pose", 3, 4, 200_000_000, 150_000_000, 0)
ORIGIN = Pose2D(0.0, 0.0, 0.0)
BEAMS = np.linspace(0.1, 1.0, 8)
SCAN = RangeScan(5, np.zeros((8, 2)), BEAMS, BEAMS, BEAMS, np.append(BEAMS[:-1], np.inf), 0.0, 5.0)
GRID = OccupancyGrid(np.array([[-1, 100], [0, 7]], np.int8), 0.1, ORIGIN)
TRACK = PoseTrack(np.array([10, 20]), np.arange(6.0).reshape(2, 3))


def changed(data: bytes, change: Callable[[Any], None]) -> bytes:
    (length,) = struct.unpack_from("<I", data)
    header = msgpack.unpackb(data[4 : 4 + length])
    change(header)
    packed, tail = msgpack.packb(header), data[4 + length + -(4 + length) % 64 :]
    head = struct.pack("<I", len(packed)) + packed
    return head + (bytes(-len(head) % 64) + tail if tail else b"")


def test_a_nested_message_with_arrays_is_read() -> None:
    back, _ = decode(encode(Path(1, np.ones((3, 2)), 2.0, GRID), AT), "navloom.Path/2")
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


def test_changing_bearings_are_read_as_sent() -> None:
    for turn in (1, 2, 2, 3, 1):
        scan = replace(SCAN, bearings=BEAMS + turn)
        back, _ = decode(encode(scan, AT), "navloom.RangeScan/1")
        assert isinstance(back, RangeScan) and back.bearings.tolist() == (BEAMS + turn).tolist()


def test_arrays_of_other_sizes_than_their_message_agrees_on_are_refused_each_time() -> None:
    data = changed(encode(TRACK, AT), lambda h: h["arrays"].__setitem__(0, ["<i8", [1], 0]))
    for _ in range(2):
        with pytest.raises(CodecError, match=r"PoseTrack\.poses: got shape \(2, 3\), expected"):
            decode(data, "navloom.PoseTrack/1")


def test_an_array_that_is_named_twice_is_held_twice() -> None:
    data = changed(encode(SCAN, AT), lambda h: h["fields"].update(half_angles=1))
    back, _ = decode(data, "navloom.RangeScan/1")
    assert isinstance(back, RangeScan) and back.half_angles.tolist() == back.bearings.tolist() == BEAMS.tolist()
