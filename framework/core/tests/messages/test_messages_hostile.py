"""Hostile bytes give a CodecError with a short text, and cost little memory."""

from __future__ import annotations

import struct
import time
import timeit
import tracemalloc
from typing import Any

import msgpack
import pytest
from navloom.messages import SCHEMAS, Envelope, Point2D, StepReport
from navloom.messages.bounds import header_limit
from navloom.messages.codec import CodecError, decode, encode, read_envelope, schema_label

AT = Envelope("lab/r1/localizer/main/pose", 3, 4, 200_000_000, 150_000_000, 0)
POINT = "navloom.Point2D/1"
REPORT = "navloom.StepReport/1"


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
def test_deep_nesting_is_refused_or_skipped(depth: int, where: str, opening: bytes) -> None:
    deep = opening * depth + b"\xc0"
    parts = {"envelope": msgpack.packb(AT), "fields": msgpack.packb({"x": 1.0, "y": 2.0}), "arrays": b"\x90"}
    if where == "x":
        parts["fields"] = b"\x82" + msgpack.packb("x") + deep + msgpack.packb("y") + b"\x00"
    else:
        parts[where] = deep
    packed = bytes([0x80 | len(parts)]) + b"".join(msgpack.packb(name) + part for name, part in parts.items())
    data = with_header(deep if where == "header" else packed)
    if where == "unknown" and len(packed) <= header_limit(Point2D):
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


@pytest.mark.parametrize("claim", [256, 4096, 1_000_000])
def test_nested_lists_that_claim_more_than_they_hold_allocate_little(claim: int) -> None:
    claims = b"\xdd" + claim.to_bytes(4, "big")
    for label, size in ((POINT, 600), (REPORT, 1000), (REPORT, 250_000)):
        nested = claims * min(900, size // 5 - 1)
        data = with_header(b"\x81" + msgpack.packb("fields") + nested + bytes(size - len(nested)))
        assert peak_of_refusal(data, label) < 5_000_000


def nested(size: int) -> bytes:
    """Lists of 15 empty maps, in lists of 15, and so on: the most objects for the fewest bytes."""
    one = b"\x80"
    while len(one) * 15 + 1 <= size:
        one = b"\x9f" + one * 15
    count = size // len(one)
    return b"\xdd" + count.to_bytes(4, "big") + one * count


def report_with(name: str, value: bytes) -> bytes:
    """A step report with a field of these bytes."""
    whole = encode(StepReport("tick", (), (), True, 1, 0, 5, "", ""), AT)
    fields = msgpack.unpackb(whole[4:])["fields"]
    fields.pop(name, None)
    packed = b"".join(msgpack.packb(key) + msgpack.packb(entry) for key, entry in fields.items())
    packed = bytes([0x81 + len(fields)]) + packed + msgpack.packb(name) + value
    parts = {"envelope": msgpack.packb(AT), "fields": packed, "arrays": b"\x90"}
    return with_header(b"\x83" + b"".join(msgpack.packb(key) + part for key, part in parts.items()))


@pytest.mark.parametrize("size", [1 << 20, 16 << 20, 62 << 20], ids=["1 MB", "16 MB", "62 MB"])
@pytest.mark.parametrize("label", [POINT, "navloom.Command/1", REPORT])
def test_a_header_larger_than_its_class_allows_is_refused_unread(size: int, label: str) -> None:
    data = report_with("unknown", nested(size))
    assert "bytes, expected at most" in refusal(data, label)
    assert peak_of_refusal(data, label) < 20_000
    took = min(timeit.repeat(lambda: refusal(data, label), timer=time.thread_time, number=1, repeat=5))
    assert took < 0.005, took  # read, 1 MB took 0.4 s


def test_an_unknown_field_is_skipped_and_not_built() -> None:
    data = report_with("unknown", nested(200_000))
    tracemalloc.start()
    try:
        assert decode(data, REPORT)[0] == StepReport("tick", (), (), True, 1, 0, 5, "", "")
        assert read_envelope(data) == AT
        assert tracemalloc.get_traced_memory()[1] < 1_000_000  # built, they are 12 MB
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["trigger", "read", "published", "enabled", "duration_ns", "told"])
def test_a_field_of_a_wrong_kind_is_refused_and_not_built(name: str) -> None:
    data = report_with(name, nested(200_000))
    assert len(refusal(data, REPORT)) < 200
    assert peak_of_refusal(data, REPORT) < 1_000_000


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("trigger", b"\x80", "got a map, expected a single value"),
        ("trigger", b"\x90", "got a list, expected a single value"),
        ("read", b"\xdc\x04\x01" + b"\x80" * 1025, "read: got 1025 items, expected at most 1024"),
        ("read", b"\xc0", "read: got NoneType, expected a list"),
        ("read", b"\x91\x07", "read: got int, expected a map of fields"),
        ("read", b"\x91\x81\xa5input\xa1a", "read: field 'sequences' is missing"),
    ],
)
def test_a_long_header_is_checked_against_the_declaration(name: str, value: bytes, text: str) -> None:
    long = msgpack.packb("x" * 5000)  # so that the header is long, whatever the value is
    data = report_with(name, value + msgpack.packb("more") + long)
    packed = data[4:].replace(b"fields\x8a", b"fields\x8b").replace(b"fields\x89", b"fields\x8a")
    assert text in refusal(with_header(packed), REPORT)


def test_a_map_with_far_more_fields_than_declared_is_refused() -> None:
    many = b"\xde\x00\x40" + b"".join(msgpack.packb(f"f{n}") + b"\x00" for n in range(64))
    data = with_header(b"\x81" + msgpack.packb("fields") + many + bytes(2000))
    assert "a map of fields holds 64 entries, expected at most 41" in refusal(data, REPORT)


def test_bytes_behind_a_long_header_are_refused() -> None:
    data = report_with("unknown", msgpack.packb("x" * 2000))
    assert "the header has 3 bytes after its end" in refusal(with_header(data[4:] + b"abc"), REPORT)


@pytest.mark.parametrize("label", ["x" * 10_000, "navloom.Command/" + "9" * 10_000])
def test_a_long_label_gives_a_short_text(label: str) -> None:
    assert len(refusal(b"\0" * 8, label)) < 300


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
def test_a_decoded_message_passes_the_checks_of_its_constructor(label: str, fields: Any, text: str) -> None:
    arrays = [["|i1", [1, 1], 0], ["|i1", [1, 1], 64], ["<f8", [0, 2], 0]]
    data = with_header({"envelope": AT, "fields": fields, "arrays": arrays})
    data += bytes(-len(data) % 64) + bytes(64) + b"\xfb"
    written = schema_label(SCHEMAS[f"navloom.{label}"])
    assert refusal(data, written).startswith(f"{written}: {text}")
