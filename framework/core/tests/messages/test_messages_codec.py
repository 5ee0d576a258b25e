"""The bytes of messages: their exact layout, and every way in which bytes can be wrong."""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import msgpack
import numpy as np
import pytest
from navloom.messages import (
    SCHEMAS,
    Array,
    Contact,
    Envelope,
    GateStatus,
    Goal,
    MapUpdate,
    Message,
    OccupancyGrid,
    Odometry,
    Path,
    Point2D,
    Pose2D,
    PoseTrack,
    Selection,
    StopReason,
    Trajectory,
    Twist2D,
    message,
)
from navloom.messages.bounds import header_limit
from navloom.messages.codec import CodecError, decode, encode, redirected, schema_label

AT = Envelope("lab/r1/localizer/main/pose", 3, 4, 200_000_000, 150_000_000, 0)
STANDING = Odometry(5, Pose2D(1.0, 2.0, 0.5), Twist2D(0.0, 0.0, 0.0))
TRACK = PoseTrack(np.array([10, 20]), np.arange(6.0).reshape(2, 3))
ODOMETRY = "navloom.Odometry/1"
PATH = "navloom.Path/2"
TRACK_LABEL = "navloom.PoseTrack/1"


@pytest.fixture(autouse=True)
def _forget_declared() -> Iterator[None]:
    before = dict(SCHEMAS)
    yield
    SCHEMAS.clear()
    SCHEMAS.update(before)


def header_of(data: bytes) -> Any:
    (length,) = struct.unpack_from("<I", data)
    return msgpack.unpackb(data[4 : 4 + length])


def with_header(header: Any, tail: bytes = b"") -> bytes:
    """Bytes of a header made by hand; the tail begins at the first multiple of 64 behind it."""
    packed = header if isinstance(header, bytes) else msgpack.packb(header)
    head = struct.pack("<I", len(packed)) + packed
    return head + (bytes(-len(head) % 64) + tail if tail else b"")


def changed(data: bytes, change: Callable[[Any], None]) -> bytes:
    (length,) = struct.unpack_from("<I", data)
    header = header_of(data)
    change(header)
    end = 4 + length
    return with_header(header, data[end + -end % 64 :])


def refusal(data: bytes | memoryview, label: str) -> str:
    with pytest.raises(CodecError) as caught:
        decode(data, label)
    return str(caught.value)


# Layout


def test_a_message_without_arrays_is_its_length_and_one_map() -> None:
    data = encode(Point2D(1.5, -2.0), AT)
    assert data[4:] == msgpack.packb(
        {
            "envelope": ["lab/r1/localizer/main/pose", 3, 4, 200_000_000, 150_000_000, 0],
            "fields": {"x": 1.5, "y": -2.0},
            "arrays": [],
        }
    )
    assert data[:4] == (len(data) - 4).to_bytes(4, "little")


def test_arrays_lie_at_multiples_of_64_in_the_order_of_the_fields() -> None:
    data = encode(TRACK, AT)
    header = header_of(data)
    assert header["fields"] == {"stamps_ns": 0, "poses": 1}
    assert header["arrays"] == [["<i8", [2], 0], ["<f8", [2, 3], 64]]
    start = 128  # 4 bytes of length and 102 of header end at 106
    assert data[:4] == b"\x66\0\0\0"
    assert data[start : start + 16] == np.array([10, 20]).tobytes()
    assert data[start + 64 :] == np.arange(6.0).tobytes()
    assert data[106:128] == bytes(22) and data[144:192] == bytes(48)


def test_an_empty_array_takes_no_room() -> None:
    data = encode(Trajectory(1, np.zeros((0, 6))), AT)
    assert header_of(data)["arrays"] == [["<f8", [0, 6], 0]]
    assert len(data) == 4 + struct.unpack_from("<I", data)[0]


def test_arrays_of_nested_messages_are_stored_in_field_order() -> None:
    grid = OccupancyGrid(np.array([[0, 100]], np.int8), 0.1, Pose2D(0.0, 0.0, 0.0))
    back, _ = decode(encode(MapUpdate(1, grid, np.ones((1, 4)), ()), AT), "navloom.MapUpdate/1")
    assert isinstance(back, MapUpdate)
    assert (back.grid.cells.tolist(), back.segments.tolist()) == ([[0, 100]], [[1.0] * 4])
    open_path = decode(encode(Path(1, np.zeros((1, 2)), 0.0, grid), AT), PATH)[0]
    assert isinstance(open_path, Path) and open_path.traversable is not None
    assert open_path.traversable.cells.tolist() == [[0, 100]]


def test_the_label_names_schema_and_version() -> None:
    assert schema_label(Odometry) == ODOMETRY


def test_the_envelope_survives_a_round_trip() -> None:
    assert decode(encode(STANDING, AT), ODOMETRY) == (STANDING, AT)


def test_decoded_arrays_are_read_only_views_of_the_bytes() -> None:
    """The track is one that no other test decodes: an array that was decoded before is kept instead of viewed again."""
    data = encode(PoseTrack(np.array([13, 29]), np.arange(3.0, 9.0).reshape(2, 3)), AT)
    back, _ = decode(data, TRACK_LABEL)
    assert isinstance(back, PoseTrack)
    first = np.frombuffer(data, np.uint8).ctypes.data
    assert back.stamps_ns.ctypes.data - first == 128 and back.poses.ctypes.data - first == 192
    assert not back.poses.flags.writeable and not back.poses.flags.owndata
    with pytest.raises(ValueError):
        back.poses.flags.writeable = True


def test_views_of_writable_memory_are_read_only_and_not_copied() -> None:
    memory = bytearray(encode(TRACK, AT))
    back, _ = decode(memoryview(memory), TRACK_LABEL)
    assert isinstance(back, PoseTrack)
    assert not back.poses.flags.writeable
    assert np.shares_memory(back.poses, np.frombuffer(memory, np.uint8))


def test_bytes_at_an_odd_address_give_aligned_arrays() -> None:
    memory = b"-" + encode(TRACK, AT)
    back, _ = decode(memoryview(memory)[1:], TRACK_LABEL)
    assert isinstance(back, PoseTrack)
    assert back.poses.flags.aligned and not back.poses.flags.writeable
    assert back.poses.tolist() == TRACK.poses.tolist()


def test_threads_encode_at_once_without_mixing_their_bytes() -> None:
    poses = [Pose2D(float(i), 0.0, 0.0) for i in range(4)]
    expected = [encode(pose, AT) for pose in poses]
    wrong: list[int] = []

    def work(i: int) -> None:
        wrong.extend(i for _ in range(2000) if encode(poses[i], AT) != expected[i])

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_an_envelope_that_cannot_be_packed_leaves_the_next_message_whole() -> None:
    good = encode(STANDING, AT)
    with pytest.raises(UnicodeEncodeError):
        encode(STANDING, AT._replace(key="\ud800"))
    assert encode(STANDING, AT) == good


# Tolerance


def test_unknown_fields_arrays_and_envelope_entries_are_skipped() -> None:
    def newer(header: Any) -> None:
        header["fields"]["slip"] = {"nested": [1, None, b"x"]}
        header["fields"]["pose"]["z"] = 0.0
        header["arrays"].append(["<f4", [1], 0])
        header["envelope"].append("more")
        header["signature"] = b"\0"

    data = changed(encode(STANDING, AT), newer) + bytes(64)
    assert decode(data, ODOMETRY) == (STANDING, AT)


def test_a_whole_number_for_a_float_is_taken_from_writers_that_have_one_kind_of_number() -> None:
    data = changed(encode(Point2D(3.0, 0.5), AT), lambda h: h["fields"].update(x=3))
    back, _ = decode(data, "navloom.Point2D/1")
    assert back == Point2D(3.0, 0.5) and encode(back, AT) == encode(Point2D(3.0, 0.5), AT)


# Refusals: schema and version


def test_an_unknown_schema_is_refused() -> None:
    assert "schema 'navloom.Nothing/1' is unknown here" in refusal(encode(STANDING, AT), "navloom.Nothing/1")


@pytest.mark.parametrize(
    "label", ["navloom.Odometry/2", "navloom.Odometry", "navloom.Odometry/", "navloom.Odometry/01"]
)
def test_another_version_is_refused_with_both(label: str) -> None:
    assert f"schema {label!r}: this side speaks version 1" in refusal(encode(STANDING, AT), label)


def test_the_bytes_of_another_message_are_refused() -> None:
    assert "field 'stamp_ns' is missing; got ['x', 'y']" in refusal(encode(Point2D(0.0, 0.0), AT), ODOMETRY)


# Refusals: fields


def test_a_missing_field_is_named_with_its_place() -> None:
    data = changed(encode(STANDING, AT), lambda h: h["fields"]["pose"].pop("heading"))
    assert refusal(data, ODOMETRY) == f"{ODOMETRY}: pose: field 'heading' is missing; got ['x', 'y']"


def test_a_missing_optional_field_is_missing_too() -> None:
    data = changed(encode(Goal(1, 0.0, 0.0, None, ()), AT), lambda h: h["fields"].pop("heading"))
    assert "field 'heading' is missing" in refusal(data, "navloom.Goal/1")


WRONG = [None, True, "1", b"1", [1], {"x": 1}, msgpack.ExtType(5, b"x"), msgpack.Timestamp(1), 2**64 - 1, -(2**63)]


@pytest.mark.parametrize("value", [*WRONG, 1.5], ids=str)
def test_a_wrong_value_of_a_nested_message_is_refused(value: Any) -> None:
    data = changed(encode(STANDING, AT), lambda h: h["fields"].update(pose=value))
    assert f"{ODOMETRY}: pose: " in refusal(data, ODOMETRY)


@pytest.mark.parametrize("value", [*WRONG[:-2], math.nan, math.inf, -math.inf], ids=str)
def test_a_wrong_value_of_a_float_is_refused_by_name(value: Any) -> None:
    data = changed(encode(STANDING, AT), lambda h: h["fields"]["pose"].update(x=value))
    assert f"{ODOMETRY}: pose: Pose2D.x: got " in refusal(data, ODOMETRY)


@pytest.mark.parametrize("value", [*WRONG[:-1], 1.5], ids=str)
def test_a_wrong_value_of_a_whole_number_is_refused_by_name(value: Any) -> None:
    data = changed(encode(STANDING, AT), lambda h: h["fields"].update(stamp_ns=value))
    assert f"{ODOMETRY}: Odometry.stamp_ns: got " in refusal(data, ODOMETRY)


@pytest.mark.parametrize("value", [v for v in WRONG if v is not True], ids=str)
def test_a_wrong_value_of_a_bool_is_refused_by_name(value: Any) -> None:
    data = changed(encode(Contact(True), AT), lambda h: h["fields"].update(touching=value))
    assert "Contact.touching: got " in refusal(data, "navloom.Contact/1")


@pytest.mark.parametrize("value", [v for v in WRONG if v != [1]] + [[None], [["a"]], [3]], ids=str)
def test_a_wrong_value_of_a_tuple_is_refused_by_name(value: Any) -> None:
    data = changed(encode(Selection(1, 0, ("mapper a",)), AT), lambda h: h["fields"].update(instances=value))
    assert "Selection.instances" in refusal(data, "navloom.Selection/1")


@pytest.mark.parametrize("value", [*WRONG, [{}], [None], [[]]], ids=str)
def test_a_wrong_value_of_a_tuple_of_messages_is_refused_by_name(value: Any) -> None:
    data = changed(encode(Goal(1, 0.0, 0.0, None, ()), AT), lambda h: h["fields"].update(via=value))
    assert "navloom.Goal/1: via: " in refusal(data, "navloom.Goal/1")


@pytest.mark.parametrize("value", [*WRONG, -1, 1, 2**40, 0.0], ids=str)
def test_a_wrong_number_of_an_array_is_refused(value: Any) -> None:
    data = changed(encode(Path(1, np.zeros((1, 2)), 0.0, None), AT), lambda h: h["fields"].update(points=value))
    assert f"{PATH}: points: got " in refusal(data, PATH)


# Refusals: envelope and header


@pytest.mark.parametrize(
    "value",
    [None, {}, "k", [], ["k", 1, 2, 3, 4], [1, 1, 2, 3, 4, 5], [b"k", 1, 2, 3, 4, 5], ["k", 1, 2, 3, 4, True],
     ["k", -1, 2, 3, 4, 5], ["k", 1, 2, 3.0, 4, 5], ["k", 1, 2, 2**63, 4, 5], ["k", 1, None, 3, 4, 5]],
    ids=str,
)  # fmt: skip
def test_a_wrong_envelope_is_refused(value: Any) -> None:
    data = changed(encode(STANDING, AT), lambda h: h.update(envelope=value))
    assert f"{ODOMETRY}: envelope is " in refusal(data, ODOMETRY)


@pytest.mark.parametrize("part", ["envelope", "fields", "arrays"])
def test_a_header_without_one_of_its_parts_is_refused(part: str) -> None:
    assert refusal(changed(encode(STANDING, AT), lambda h: h.pop(part)), ODOMETRY).startswith(f"{ODOMETRY}: ")


@pytest.mark.parametrize("header", [None, 1, "x", [], [1, 2]], ids=str)
def test_a_header_that_is_not_a_map_is_refused(header: Any) -> None:
    assert "expected a map" in refusal(with_header(header), ODOMETRY)


@pytest.mark.parametrize(
    "packed",
    [b"", b"\xc1", b"\x81\xc0\x01", b"\x81\x90\x01", b"\x81\xa1", b"\xa1\xff", b"\x80\x80", b"\x93\x01",
     b"\x81\xa1a\xd9\xff", b"\xde\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xdd\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff",
     b"\xdb\xff\xff\xff\xff", b"\xc9\xff\xff\xff\xff\x01", b"\xd7\xff\xff\xff\xff\xff\xff\xff\xff\xff"],
    ids=lambda packed: packed.hex() or "empty",
)  # fmt: skip
def test_a_header_that_is_not_messagepack_is_refused(packed: bytes) -> None:
    assert "the header is not MessagePack" in refusal(with_header(packed), ODOMETRY)


# Refusals: arrays


def track_with(entry: Any) -> bytes:
    return changed(encode(TRACK, AT), lambda h: h["arrays"].__setitem__(1, entry))


@pytest.mark.parametrize(
    "entry",
    [None, 1, "abc", {}, [], ["<f8"], ["<f8", [2, 3]], ["<f8", [2, 3], 64, 0],
     [["<f8"], [2, 3], 64], [{}, [2, 3], 64], [None, [2, 3], 64], [b"<f8", [2, 3], 64],
     ["|O", [2, 3], 64], [">f8", [2, 3], 64], ["<c16", [1, 3], 64], ["V8", [2, 3], 64], ["<M8[ns]", [2, 3], 64],
     ["f8,f8", [1, 3], 64], ["|S8", [2, 3], 64], ["", [2, 3], 64],
     ["<f8", None, 64], ["<f8", "23", 64], ["<f8", 6, 64], ["<f8", {}, 64], ["<f8", [2, 3.0], 64],
     ["<f8", [2, None], 64], ["<f8", [True, 3], 64], ["<f8", [[2], 3], 64],
     ["<f8", [-2, 3], 64], ["<f8", [-2, -3], 64], ["<f8", [2, -1], 64],
     ["<f8", [2, 3], -64], ["<f8", [2, 3], 64.0], ["<f8", [2, 3], None], ["<f8", [2, 3], True]],
    ids=str,
)  # fmt: skip
def test_a_malformed_entry_of_the_arrays_is_refused(entry: Any) -> None:
    assert f"{TRACK_LABEL}: array 1 is " in refusal(track_with(entry), TRACK_LABEL)


@pytest.mark.parametrize(
    "entry",
    [["<f8", [2, 3], 128], ["<f8", [3, 3], 64], ["<f8", [2**40, 2**40], 64], ["<f8", [2**63, 2], 64],
     ["<f8", [2**62, 8], 0], ["<f8", [2**64 - 1], 64], ["<f8", [2, 3], 2**64 - 64], ["<f8", [2, 3], 2**63],
     ["<f8", [0, 2**40, 2**40], 0], ["<f8", [0, 2**64 - 1], 0], ["<f8", [1] * 9, 64], ["<f8", [1] * 70, 64],
     ["<f8", [2, 3], 8], ["<f8", [2, 3], 1], ["<f8", [2, 3], 63]],
    ids=str,
)  # fmt: skip
def test_an_array_that_does_not_lie_in_the_bytes_at_a_multiple_of_64_is_refused(entry: Any) -> None:
    data = track_with(entry)
    expected = f"expected it at a multiple of 64 within the {len(data)} bytes given"
    assert expected in refusal(data, TRACK_LABEL)


@pytest.mark.parametrize(
    "entry",
    [["<f4", [2, 3], 64], ["<i8", [2, 3], 64], ["<f8", [3, 2], 64], ["<f8", [6], 64], ["<f8", [1, 3], 64]],
    ids=str,
)
def test_an_array_of_another_type_or_shape_than_the_field_is_refused_by_name(entry: Any) -> None:
    assert "PoseTrack.poses: got " in refusal(track_with(entry), TRACK_LABEL)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_in_the_bytes_of_an_array_are_refused(bad: float) -> None:
    data = encode(TRACK, AT)[:-8] + struct.pack("<d", bad)
    assert f"PoseTrack.poses: holds {bad}, expected finite numbers" in refusal(data, TRACK_LABEL)


def test_more_arrays_than_the_class_can_hold_are_refused() -> None:
    data = changed(encode(TRACK, AT), lambda h: h["arrays"].extend([["<f8", [0], 0]] * 255))
    assert f"the header takes 2144 bytes, expected at most {header_limit(PoseTrack)}" in refusal(data, TRACK_LABEL)


def test_a_message_with_more_than_256_arrays_is_not_encoded() -> None:
    @message()
    class Bundle(Message):
        paths: tuple[Path, ...]

    path = Path(1, np.zeros((1, 2)), 0.0, None)
    whole, _ = decode(encode(Bundle((path,) * 256), AT), schema_label(Bundle))
    assert isinstance(whole, Bundle) and len(whole.paths) == 256
    with pytest.raises(CodecError, match="holds 257 arrays, expected at most 256"):
        encode(Bundle((path,) * 257), AT)
    more = changed(encode(Bundle((path,) * 256), AT), lambda h: h["arrays"].append(["<f8", [0], 0]))
    assert "arrays: got 257 items, expected at most 256" in refusal(more, schema_label(Bundle))


def test_arrays_of_every_element_type_and_in_tuples_come_back() -> None:
    @message()
    class Mixed(Message):
        a: Annotated[np.ndarray, Array("float32", ())]
        b: Annotated[np.ndarray, Array("int32", ("n",))] | None
        c: Annotated[np.ndarray, Array("bool", ("n", 1))]
        d: tuple[tuple[Point2D, ...], ...]
        e: tuple[float | None, ...]
        f: tuple[Path | None, ...]

    path = Path(1, np.ones((1, 2)), 0.0, None)
    corner = Point2D(1.0, 2.0)
    made = Mixed(np.array(2.5, np.float32), np.array([7], np.int32), np.array([[True]]), ((corner,), ()), (None, 1.0),
                 (None, path))  # fmt: skip
    back, _ = decode(encode(made, AT), schema_label(Mixed))
    assert isinstance(back, Mixed) and back.b is not None and back.f[1] is not None
    assert (back.a[()], back.b.tolist(), back.c.tolist()) == (2.5, [7], [[True]])
    assert (back.d, back.e, back.f[0], back.f[1].points.tolist()) == (((corner,), ()), (None, 1.0), None, [[1.0, 1.0]])
    bare, _ = decode(encode(Mixed(made.a, None, made.c, (), (), ()), AT), schema_label(Mixed))
    assert isinstance(bare, Mixed) and bare.b is None


def test_a_field_that_is_newer_than_the_bytes_has_its_default() -> None:
    status = GateStatus("none", "", True, False, StopReason("operator"), ())
    data = encode(status, AT)
    for name in ("share", "limit", "place", "distance"):
        data = changed(data, lambda header, name=name: header["fields"].pop(name))  # type: ignore[misc]
    assert decode(data, schema_label(GateStatus))[0] == status


@pytest.mark.parametrize("sent", [STANDING, TRACK, PoseTrack(np.zeros(0, np.int64), np.zeros((0, 3)))])
def test_a_redirected_message_has_the_bytes_of_one_encoded_under_that_key(sent: Message) -> None:
    for length in range(1, 80):  # the arrays move with the header's end
        at = AT._replace(key="k" * length)
        assert redirected(memoryview(encode(sent, AT)), at.key) == (encode(sent, at), at)


def test_what_an_unknown_version_adds_is_kept_under_another_key() -> None:
    header = header_of(encode(STANDING, AT))
    added = {"before": [1, {"deep": "x"}], **header, "fields": {**header["fields"], "later": 2}}
    data, at = redirected(with_header(added), "a/b/c")
    assert header_of(data) == {**added, "envelope": [*AT._replace(key="a/b/c")]} and at.key == "a/b/c"


@pytest.mark.parametrize("data", [b"", b"\xff" * 8, with_header({"fields": {}}), with_header(b"\x81\xa1")])
def test_bytes_without_an_envelope_are_not_redirected(data: bytes) -> None:
    with pytest.raises(CodecError):
        redirected(data, "a/b/c")
