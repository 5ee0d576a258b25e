"""Values that a message accepts, those that it refuses, and the texts of its errors."""

from __future__ import annotations

import copy
import inspect
import math
import pickle
import re
from collections.abc import Iterator
from dataclasses import FrozenInstanceError, dataclass, replace
from typing import Annotated, Any

import numpy as np
import pytest
from navloom.messages import (
    OUTCOMES,
    SCHEMAS,
    Array,
    GateStatus,
    Goal,
    GoalResult,
    HandOver,
    InputRead,
    Message,
    MessageError,
    Most,
    Name,
    OccupancyGrid,
    Odometry,
    Parameters,
    Path,
    Point2D,
    Pose2D,
    PoseEstimate,
    PoseTrack,
    RangeScan,
    Selection,
    SweepRequest,
    Trajectory,
    Truth,
    Twist2D,
    message,
)

POSE = Pose2D(1.0, 2.0, 0.5)
STILL = Twist2D(0.0, 0.0, 0.0)


@pytest.fixture(autouse=True)
def _forget_declared() -> Iterator[None]:
    before = dict(SCHEMAS)
    yield
    SCHEMAS.clear()
    SCHEMAS.update(before)


def scan(**changed: Any) -> RangeScan:
    zeros = np.zeros(3)
    fields: dict[str, Any] = {
        "stamp_ns": 0,
        "origins": np.zeros((3, 2)),
        "bearings": zeros,
        "half_angles": zeros,
        "time_offsets": zeros,
        "ranges": np.array([1.0, math.inf, 0.0]),
        "range_min": 0.1,
        "range_max": 5.0,
    }
    return RangeScan(**(fields | changed))


def trajectory_like(samples: np.ndarray) -> Path:
    return Path(1, samples, 1.0, None)


# Numbers


@pytest.mark.parametrize("given", [1, np.int32(1), np.float64(1.0), np.float32(1.0), 1.0])
def test_a_float_field_takes_any_real_number_and_holds_a_float(given: Any) -> None:
    held = Point2D(given, 0.0).x
    assert type(held) is float and held == 1.0


@pytest.mark.parametrize("given", ["1.0", b"1", True, np.bool_(True), None, 1j, [1.0], np.array([1.0]), np.array(1.0)])
def test_a_float_field_refuses_what_is_not_a_real_number(given: Any) -> None:
    with pytest.raises(MessageError, match=r"Point2D\.y: got .*, expected a number"):
        Point2D(0.0, given)


@pytest.mark.parametrize("given", [math.nan, math.inf, -math.inf, np.float64("nan"), 10**400, -(10**4000)])
def test_a_float_field_refuses_numbers_that_are_not_finite(given: Any) -> None:
    with pytest.raises(MessageError, match=r"Point2D\.x: got"):
        Point2D(given, 0.0)


@pytest.mark.parametrize("given", [1.7976931348623157e308, -1.7976931348623157e308, 5e-324, -0.0])
def test_the_extremes_of_a_float_are_held_bit_for_bit(given: float) -> None:
    held = Point2D(given, 0.0).x
    assert (held, math.copysign(1.0, held)) == (given, math.copysign(1.0, given))


def test_plus_infinity_is_a_clearance_and_a_hand_over_distance_and_minus_infinity_and_nan_are_not() -> None:
    assert Truth(POSE, STILL, math.inf, "", False).clearance == math.inf
    assert HandOver(False, np.float64(math.inf)).nearest == math.inf
    for bad in (-math.inf, math.nan):
        with pytest.raises(MessageError, match=r"HandOver\.nearest: got -?(inf|nan), expected a number or \+inf"):
            HandOver(False, bad)


@pytest.mark.parametrize("given", [2**63 - 1, -(2**63), np.int64(5), np.uint8(5)])
def test_an_int_field_takes_64_bits_with_sign(given: Any) -> None:
    held = SweepRequest(given).request_id
    assert type(held) is int and held == int(given)


@pytest.mark.parametrize("given", [2**63, -(2**63) - 1, 10**4000, True, 1.0, "1", None, np.float64(1.0)])
def test_an_int_field_refuses_everything_else(given: Any) -> None:
    with pytest.raises(MessageError, match=r"SweepRequest\.request_id: got"):
        SweepRequest(given)


def test_a_number_too_long_to_print_is_refused_like_any_other() -> None:
    with pytest.raises(MessageError, match=r"SweepRequest\.request_id: got a int, expected a signed 64-bit number"):
        SweepRequest(10**5000)


def test_a_bool_field_takes_numpy_bools_and_refuses_numbers() -> None:
    assert HandOver(np.bool_(True), 1.0).engaged is True
    with pytest.raises(MessageError, match=r"HandOver\.engaged: got 1, expected bool"):
        HandOver(1, 1.0)  # type: ignore[arg-type]


# Text


def test_text_of_any_language_is_taken_and_lone_surrogates_are_refused() -> None:
    assert Truth(POSE, STILL, 1.0, "Säule 柱", False).nearest == "Säule 柱"
    with pytest.raises(MessageError, match="without lone surrogates"):
        Truth(POSE, STILL, 1.0, "\ud800", False)


def test_a_numpy_string_is_held_as_a_plain_one() -> None:
    assert type(Truth(POSE, STILL, 1.0, np.str_("wall"), False).nearest) is str


def test_a_literal_takes_its_choices_only_and_the_error_names_them() -> None:
    assert GateStatus("avoider", "main", False, False, None, ()).source == "avoider"
    with pytest.raises(MessageError, match=r"GateStatus\.source: got 'wheel', expected one of none, controller"):
        GateStatus("wheel", "main", False, False, None, ())  # type: ignore[arg-type]


@pytest.mark.parametrize("given", [[], {}, np.zeros(3), None, 3])
def test_a_literal_refuses_what_is_not_text(given: Any) -> None:
    with pytest.raises(MessageError, match=r"GateStatus\.source: got .*, expected str"):
        GateStatus(given, "main", False, False, None, ())


def test_the_outcomes_are_those_a_goal_result_takes() -> None:
    assert set(OUTCOMES) == set(GoalResult.kinds["outcome"].choices)
    assert len(OUTCOMES) == len(set(OUTCOMES)) == 10


# Nested messages, tuples, None


def test_a_nested_message_must_be_of_its_class() -> None:
    with pytest.raises(MessageError, match=r"Odometry\.pose: got Point2D, expected Pose2D"):
        Odometry(0, Point2D(0.0, 0.0), STILL)  # type: ignore[arg-type]
    with pytest.raises(MessageError, match=r"Odometry\.twist: got NoneType, expected Twist2D"):
        Odometry(0, POSE, None)  # type: ignore[arg-type]


def test_a_list_is_held_as_a_tuple_and_a_wrong_item_is_named_by_its_place() -> None:
    assert Selection(1, 0, ["mapper a", "planner b"]).instances == ("mapper a", "planner b")  # type: ignore[arg-type]
    with pytest.raises(MessageError, match=r"Selection\.instances\[1\]: got 7, expected str"):
        Selection(1, 0, ("mapper a", 7))  # type: ignore[arg-type]
    with pytest.raises(MessageError, match=r"Selection\.instances: got str, expected a tuple"):
        Selection(1, 0, "mapper a")  # type: ignore[arg-type]


def test_a_tuple_holds_as_many_items_as_declared_or_4096_and_no_more() -> None:
    assert len(InputRead("scan", (1,) * 4096).sequences) == 4096
    with pytest.raises(MessageError, match="got 4097 items, expected at most 4096; use an array"):
        InputRead("scan", (1,) * 4097)
    assert len(Selection(1, 0, ("a",) * 64).instances) == 64
    with pytest.raises(MessageError, match=r"Selection\.instances: got 65 items, expected at most 64"):
        Selection(1, 0, ("a",) * 65)


@pytest.mark.parametrize("letter", ["a", "ä", "€", "🤖"])
def test_a_text_is_bounded_in_bytes_a_name_is_refused_and_words_are_cut(letter: str) -> None:
    many = 1024 // len(letter.encode())
    assert Parameters(1, (letter * many,)).values == (letter * many,)
    with pytest.raises(MessageError, match=rf"values\[0\]: got a text of {len(letter.encode()) * 2000} bytes, .* 1024"):
        Parameters(1, (letter * 2000,))
    with pytest.raises(MessageError, match=r"InputRead\.input: got a text of .* bytes, expected at most 255"):
        InputRead(letter * 256, ())
    words = GoalResult(1, "error", letter * 2000, Point2D(0.0, 0.0)).reason
    assert words == letter * ((1024 - 3) // len(letter.encode())) + "…" and len(words.encode()) <= 1024


def test_a_bound_is_declared_with_most() -> None:
    @message()
    class Bounded(Message):
        note: Annotated[str, Most(3)]
        marks: Annotated[tuple[Name, ...], Most(2)] = ()

    assert Bounded("abc", ("a", "b")).marks == ("a", "b")
    with pytest.raises(MessageError, match=r"Bounded\.note: got a text of 4 bytes, expected at most 3"):
        Bounded("abcd")
    with pytest.raises(MessageError, match=r"Bounded\.marks: got 3 items, expected at most 2"):
        Bounded("abc", ("a", "b", "c"))


def test_none_is_a_value_only_where_it_is_declared() -> None:
    assert Goal(1, 0.0, 0.0, None, ()).heading is None
    assert Path(1, np.zeros((2, 2)), 0.0, None).traversable is None
    with pytest.raises(MessageError, match=r"Path\.points: got NoneType, expected float64 of shape \('n', 2\)"):
        Path(1, None, 0.0, None)  # type: ignore[arg-type]


# Arrays


def test_a_writable_array_is_copied_so_that_a_reused_buffer_changes_nothing() -> None:
    buffer = np.array([[1.0, 2.0]])
    made = trajectory_like(buffer)
    buffer[:] = 9.0
    assert made.points.tolist() == [[1.0, 2.0]]


def test_a_read_only_view_of_a_writable_buffer_is_copied_too() -> None:
    buffer = np.array([[1.0, 2.0], [3.0, 4.0]])
    view = buffer[:1]
    view.flags.writeable = False
    made = trajectory_like(view)
    buffer[:] = 9.0
    assert made.points.tolist() == [[1.0, 2.0]]


def test_a_read_only_view_of_a_bytearray_is_copied_too() -> None:
    memory = bytearray(np.array([[1.0, 2.0]]).tobytes())
    view = np.frombuffer(memory).reshape(1, 2)
    view.flags.writeable = False
    made = trajectory_like(view)
    memory[:] = bytes(16)
    assert made.points.tolist() == [[1.0, 2.0]]


def test_an_immutable_array_is_passed_on_without_a_copy() -> None:
    owned = np.zeros((4, 2))
    owned.flags.writeable = False
    assert trajectory_like(owned).points is owned
    assert trajectory_like(owned[1:]).points.base is owned
    from_bytes = np.frombuffer(bytes(32)).reshape(2, 2)
    assert trajectory_like(from_bytes).points is from_bytes


def test_the_arrays_of_a_message_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        trajectory_like(np.zeros((2, 2))).points[0, 0] = 1.0


def test_a_strided_array_is_held_contiguous() -> None:
    made = trajectory_like(np.arange(8.0).reshape(2, 4).T[:, :2])
    assert made.points.flags.c_contiguous and made.points.tolist() == [[0, 4], [1, 5], [2, 6], [3, 7]]


@pytest.mark.parametrize(
    "given",
    [
        np.zeros((2, 2), np.float32),
        np.zeros((2, 2), ">f8"),
        np.zeros((2, 2), np.int64),
        np.zeros((2, 2), object),
        np.zeros(2),
        np.zeros((2, 2, 1)),
        [[0.0, 0.0]],
        np.ma.zeros((1, 2)),
    ],
    ids=str,
)
def test_another_element_type_or_number_of_axes_is_refused(given: Any) -> None:
    with pytest.raises(MessageError, match=r"Path\.points: got .*, expected float64 of shape \('n', 2\)"):
        trajectory_like(given)


def test_a_wrong_size_is_refused_with_both_shapes() -> None:
    with pytest.raises(MessageError, match=r"points: got shape \(2, 3\), expected \('n', 2\), with 2 = 2"):
        trajectory_like(np.zeros((2, 3)))


def test_sizes_of_one_name_must_agree_over_the_fields_of_a_message() -> None:
    with pytest.raises(MessageError, match=r"PoseTrack\.poses: got shape \(2, 3\), expected \('n', 3\), with n = 1"):
        PoseTrack(np.zeros(1, np.int64), np.zeros((2, 3)))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("size", [1, 2, 2049, 5000])
def test_numbers_that_are_not_finite_are_found_in_arrays_of_any_length(bad: float, size: int) -> None:
    points = np.zeros((size, 2))
    points[size // 2, 1] = bad
    with pytest.raises(MessageError, match=rf"Path\.points: holds {bad}, expected finite numbers"):
        trajectory_like(points)


@pytest.mark.filterwarnings("error")
def test_opposite_infinities_and_overflowing_squares_are_checked_without_a_warning() -> None:
    assert trajectory_like(np.full((2, 2), 1e308)).points[0, 0] == 1e308
    with pytest.raises(MessageError, match="holds inf"):
        trajectory_like(np.array([[math.inf, -math.inf]]))


def test_ranges_may_be_plus_infinity_and_nothing_below_zero_or_nan() -> None:
    assert scan().ranges.tolist() == [1.0, math.inf, 0.0]
    for bad in (-1e-300, -math.inf, math.nan):
        with pytest.raises(MessageError, match=r"RangeScan\.ranges: holds .*, expected values >= 0, without NaN"):
            scan(ranges=np.array([1.0, bad, math.inf]))


def test_a_field_with_a_least_value_that_is_not_unbounded_refuses_plus_infinity() -> None:
    with pytest.raises(MessageError, match=r"RangeScan\.half_angles: holds inf, expected finite numbers"):
        scan(half_angles=np.array([0.0, math.inf, 0.0]))


def test_an_unbounded_array_without_a_least_value_refuses_minus_infinity_and_nan() -> None:
    @message()
    class Costs(Message):
        values: Annotated[np.ndarray, Array("float32", ("n",), infinite=True)]

    assert Costs(np.array([-1.0, math.inf], np.float32)).values[1] == math.inf
    for bad in (-math.inf, math.nan):
        with pytest.raises(MessageError, match=r"Costs\.values: holds NaN or -inf"):
            Costs(np.array([bad], np.float32))


def test_empty_arrays_are_taken_but_for_the_points_of_a_path() -> None:
    assert Trajectory(1, np.zeros((0, 6))).samples.shape == (0, 6)
    with pytest.raises(MessageError, match=r"Path\.points: got shape \(0, 2\), expected at least one element"):
        trajectory_like(np.zeros((0, 2)))


@pytest.mark.parametrize(
    ("given", "held"),
    [
        (math.pi, math.pi),
        (-math.pi, -math.pi),
        (math.pi + 5e-10, -math.pi + 5e-10),
        (-math.pi - 5e-10, math.pi - 5e-10),
        (3, 3.0),
    ],
)
def test_a_heading_is_held_bit_for_bit_and_wrapped_where_rounding_put_it_beyond_pi(given: float, held: float) -> None:
    assert Pose2D(0.0, 0.0, given).heading == pytest.approx(held, abs=0.0 if given in (3, held) else 1e-15)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (90.0, "Pose2D.heading: got 90.0, expected rad in [-π, π]; degrees? math.radians(90) is 1.571"),
        (3.2, "Pose2D.heading: got 3.2, expected rad in [-π, π]; wrap it: math.remainder(heading, math.tau)"),
        (math.pi + 2e-9, "expected rad in [-π, π]; wrap it"),
    ],
)
def test_a_heading_beyond_pi_is_refused_with_a_hint(given: float, text: str) -> None:
    with pytest.raises(MessageError, match=re.escape(text)):
        Pose2D(0.0, 0.0, given)


@pytest.mark.parametrize(
    ("cell", "resolution", "text"),
    [
        (-5, 0.1, "OccupancyGrid.cells: holds -5, expected values from -1 to 100"),
        (101, 0.1, "OccupancyGrid.cells: holds 101, expected values from -1 to 100"),
        (0, -0.1, "OccupancyGrid.resolution: got -0.1, expected a number above 0"),
        (0, 0.0, "OccupancyGrid.resolution: got 0.0, expected a number above 0"),
    ],
)
def test_a_grid_holds_costs_and_unknown_in_cells_of_a_size(cell: int, resolution: float, text: str) -> None:
    with pytest.raises(MessageError, match=re.escape(text)):
        OccupancyGrid(np.full((2, 2), cell, np.int8), resolution, POSE)
    assert OccupancyGrid(np.array([[-1, 100]], np.int8), 0.1, POSE).cells.tolist() == [[-1, 100]]


def test_a_stamp_is_on_the_run_clock() -> None:
    assert Odometry(0, POSE, STILL).stamp_ns == 0
    with pytest.raises(MessageError, match=r"Odometry\.stamp_ns: got -1, expected a run clock in ns, at least 0"):
        Odometry(-1, POSE, STILL)


# The class


def test_messages_are_frozen_and_have_no_other_attributes() -> None:
    with pytest.raises(FrozenInstanceError):
        POSE.x = 3.0  # type: ignore[misc]
    with pytest.raises((AttributeError, TypeError)):
        object.__setattr__(POSE, "extra", 1)


def test_plain_messages_compare_by_value_and_those_with_arrays_by_identity() -> None:
    assert Pose2D(1.0, 2.0, 0.5) == POSE and hash(Pose2D(1.0, 2.0, 0.5)) == hash(POSE)
    estimate = PoseEstimate(0, POSE, STILL, np.eye(3))
    assert estimate == estimate and estimate != PoseEstimate(0, POSE, STILL, np.eye(3))


def test_replace_checks_again() -> None:
    assert replace(POSE, x=5).x == 5.0
    with pytest.raises(MessageError, match=r"Pose2D\.x"):
        replace(POSE, x=math.nan)


@pytest.mark.parametrize("copied", [lambda m: pickle.loads(pickle.dumps(m)), copy.copy, copy.deepcopy])
def test_a_copy_is_the_same_and_read_only(copied: Any) -> None:
    made = copied(PoseEstimate(7, POSE, STILL, np.eye(3)))
    assert (made.stamp_ns, made.pose, made.covariance.tolist()) == (7, POSE, np.eye(3).tolist())
    assert not made.covariance.flags.writeable


def test_a_wrong_call_is_a_type_error_that_names_the_class() -> None:
    with pytest.raises(TypeError, match=r"Point2D\.__init__"):
        Point2D(1.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"Point2D\.__init__"):
        Point2D(1.0, 2.0, z=3.0)  # type: ignore[call-arg]


def test_the_constructor_takes_what_a_plain_dataclass_would() -> None:
    @dataclass(frozen=True)
    class Plain:
        x: float
        y: float

    assert list(inspect.signature(Point2D).parameters) == list(inspect.signature(Plain).parameters)
    assert repr(Point2D(1.0, y=2.0)) == "Point2D(x=1.0, y=2.0)"
