"""What bytes made to do harm may cost: a CodecError with a short text, and little memory."""

from __future__ import annotations

import resource
import struct
import tracemalloc
from typing import Any

import msgpack
import pytest
from navloom.messages import Envelope, Point2D
from navloom.messages.codec import CodecError, decode

AT = Envelope("lab/r1/localizer/main/pose", 3, 4, 200_000_000, 150_000_000, 0)
POINT = "navloom.Point2D/1"


def with_header(header: Any) -> bytes:
    packed = header if isinstance(header, bytes) else msgpack.packb(header)
    return struct.pack("<I", len(packed)) + packed


def refusal(data: bytes, label: str) -> str:
    with pytest.raises(CodecError) as caught:
        decode(data, label)
    return str(caught.value)


@pytest.mark.parametrize("data", [b"", b"\0", b"\0\0\0"])
def test_bytes_too_short_for_a_length_are_refused(data: bytes) -> None:
    assert f"got {len(data)} bytes, expected a header of at least 4" in refusal(data, POINT)


def test_a_length_beyond_the_end_is_refused() -> None:
    assert "the header claims 4294967295 bytes, 2 are there" in refusal(b"\xff\xff\xff\xff\x80\x80", POINT)


@pytest.mark.parametrize("depth", [10, 400, 1000, 5000, 100_000])
@pytest.mark.parametrize("where", ["header", "envelope", "fields", "arrays", "x", "unknown"])
@pytest.mark.parametrize("opening", [b"\x91", b"\x81\xa1a"], ids=["lists", "maps"])
def test_deep_nesting_is_refused_or_passed_over(depth: int, where: str, opening: bytes) -> None:
    deep = opening * depth + b"\xc0"
    parts = {"envelope": msgpack.packb(AT), "fields": msgpack.packb({"x": 1.0, "y": 2.0}), "arrays": b"\x90"}
    if where == "x":
        parts["fields"] = b"\x82" + msgpack.packb("x") + deep + msgpack.packb("y") + b"\x00"
    else:
        parts[where] = deep
    packed = bytes([0x80 | len(parts)]) + b"".join(msgpack.packb(name) + part for name, part in parts.items())
    data = with_header(deep if where == "header" else packed)
    if where == "unknown" and depth <= 1000:
        assert decode(data, POINT) == (Point2D(1.0, 2.0), AT)
    else:
        assert len(refusal(data, POINT)) < 1000


def peak_of_refusal(data: bytes, label: str) -> int:
    tracemalloc.start()
    try:
        refusal(data, label)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_claimed_shape_allocates_nothing() -> None:
    header = {
        "envelope": AT,
        "fields": {"stamps_ns": 0, "poses": 1},
        "arrays": [["<i8", [2], 0], ["<f8", [2**39, 3], 64]],
    }
    data = with_header(header) + bytes(1000)
    assert peak_of_refusal(data, "navloom.PoseTrack/1") < 100_000


def test_nested_lists_that_claim_more_than_they_hold_allocate_little() -> None:
    claims = b"\xdd" + (4096).to_bytes(4, "big")
    data = with_header(claims * 900 + bytes(2_000_000))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refusal(data, POINT)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 80_000  # kB; 900 lists of 4096 are 29 MB
    huge = with_header((b"\xdd" + (1_000_000).to_bytes(4, "big")) * 900 + bytes(2_000_000))
    assert peak_of_refusal(huge, POINT) < 5_000_000


@pytest.mark.parametrize(
    "change",
    [
        {"fields": {"x": "x" * 1_000_000, "y": 0.0}},
        {"fields": {"x": ["x" * 1_000_000] * 10, "y": 0.0}},
        {"fields": {"x" * 1_000_000: 1}},
        {"envelope": ["x" * 1_000_000] * 5},
        {"arrays": [["x" * 1_000_000, [1], 0]]},
    ],
    ids=["str", "list", "name", "envelope", "dtype"],
)
def test_error_texts_stay_short_whatever_was_sent(change: dict[str, Any]) -> None:
    header = {"envelope": AT, "fields": {"x": 0.0, "y": 0.0}, "arrays": []}
    assert decode(with_header(header), POINT) == (Point2D(0.0, 0.0), AT)
    assert len(refusal(with_header(header | change), POINT)) < 600


# --- decoded messages pass the checks of the constructor, with the same texts -----------------------------------------


@pytest.mark.parametrize(
    ("label", "fields", "text"),
    [
        (
            "Pose2D",
            {"x": 0.0, "y": 0.0, "heading": 90.0},
            "Pose2D.heading: got 90.0, expected rad in [-π, π]; degrees?",
        ),
        (
            "Odometry",
            {"stamp_ns": -1, "pose": {"x": 0.0, "y": 0.0, "heading": 0.0}, "twist": {"vx": 0.0, "vy": 0.0, "wz": 0.0}},
            "Odometry.stamp_ns: got -1, expected a run clock in ns, at least 0",
        ),
        (
            "OccupancyGrid",
            {"cells": 0, "resolution": -0.1, "origin": {"x": 0.0, "y": 0.0, "heading": 0.0}},
            "OccupancyGrid.resolution: got -0.1, expected a number above 0",
        ),
        (
            "OccupancyGrid",
            {"cells": 1, "resolution": 0.1, "origin": {"x": 0.0, "y": 0.0, "heading": 0.0}},
            "OccupancyGrid.cells: holds -5, expected values from -1 to 100",
        ),
        (
            "Path",
            {"request_id": 1, "points": 2, "length": 1.0, "traversable": None},
            "Path.points: got shape (0, 2), expected at least one element",
        ),
    ],
)
def test_a_decoded_message_is_held_to_what_its_constructor_checks(label: str, fields: Any, text: str) -> None:
    arrays = [["|i1", [1, 1], 0], ["|i1", [1, 1], 64], ["<f8", [0, 2], 0]]
    data = with_header({"envelope": AT, "fields": fields, "arrays": arrays})
    data += bytes(-len(data) % 64) + bytes(64) + b"\xfb"
    assert refusal(data, f"navloom.{label}/1").startswith(f"navloom.{label}/1: {text}")
