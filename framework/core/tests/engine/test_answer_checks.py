"""The doors: what each lets pass and refuses, tick after tick, with the words of the refusal."""

from __future__ import annotations

import inspect
import math
import re
from dataclasses import replace
from pathlib import PurePath
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from navloom.engine import answer_checks as doors
from navloom.engine.answer_checks import AnswerError, LocalizerDoor, MapperDoor, PlannerDoor, PlatformDoor, TwistDoor
from navloom.messages import (
    Contact,
    MapUpdate,
    OccupancyGrid,
    Odometry,
    Path,
    PlanFailure,
    PlanRequest,
    Point2D,
    Pose2D,
    PoseEstimate,
    RangeScan,
    RecoveryStep,
    Sweep,
    SweepRequest,
    TrackingCommand,
    Truth,
    Twist2D,
)
from navloom.roles import LocalizerInput, MapperInput, PlannerInput, PlatformInput, PlatformOutput, SensorSpec

S = 1_000_000_000
ORIGIN, STILL = Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)


class Plugin:
    """A plugin of any role, by the name of its verb."""

    sensor_kinds = {"ring": RangeScan, "tilting": Sweep}

    def __init__(self, role: str) -> None:
        self.role = role

    def advance(self) -> None: ...

    localize = update = plan = control = step = advance


LINE = inspect.getsourcelines(Plugin)[1] + inspect.getsourcelines(Plugin)[0].index(
    "    def advance(self) -> None: ...\n"
)
PLACE = f"{PurePath(__file__).name}:{LINE}"


def scan(stamp_ns: int, low: float = 0.1, high: float = 4.0) -> RangeScan:
    one = np.ones(1)
    return RangeScan(stamp_ns, np.zeros((1, 2)), 0 * one, 0 * one, 0 * one, one, low, high)


def sweep(stamp_ns: int, request_id: int) -> Sweep:
    return Sweep(
        stamp_ns, request_id, np.ones((1, 1)), np.zeros(1), np.zeros(1), np.zeros(1), "paper", 0.0, 0.0, 0.4, 0.02, 4.0
    )


# --- platform ---------------------------------------------------------------------------------------------------------


class Platform:
    """The door of a platform with a ring of sonars and a tilting laser."""

    def __init__(self) -> None:
        specs = [SensorSpec("ears", "ring"), SensorSpec("eye", "tilting")]
        self.door = PlatformDoor(Plugin("platform"), specs)  # type: ignore[arg-type]

    def give(self, now_ns: int, request: int | None = None, odometry_ns: int | None = None, **scans: Any) -> None:
        """Check an answer at a run clock; its odometry has the same stamp unless another is given."""
        stamp = now_ns if odometry_ns is None else odometry_ns
        answer = PlatformOutput(Odometry(stamp, ORIGIN, STILL), scans, Contact(False), None)
        asked = None if request is None else SweepRequest(request)
        assert self.door.check(answer, PlatformInput(STILL, asked, now_ns)) is answer


def refused(text: str) -> Any:
    return pytest.raises(AnswerError, match=re.escape(text))


@pytest.mark.parametrize("request_id", [-1, 2, 6])
def test_a_sweep_must_belong_to_a_request_so_far(request_id: int) -> None:
    platform = Platform()
    platform.give(0, eye=sweep(0, 0))
    with refused("gave a sweep for request 1, expected 0 for a continuous sweep"):
        platform.give(S, eye=sweep(S, 1))
    platform.give(S, request=4, eye=sweep(S, 4))
    platform.give(2 * S, request=5, eye=sweep(2 * S, 3))
    platform.give(3 * S, eye=sweep(3 * S, 5))
    platform.give(4 * S, request=2, eye=sweep(4 * S, 5))
    if request_id != 2:
        with refused(f"gave a sweep for request {request_id}, expected 5, the newest request, or 0 for a continuous"):
            platform.give(5 * S, eye=sweep(5 * S, request_id))


def test_odometry_may_repeat_but_not_go_back() -> None:
    platform = Platform()
    platform.give(2 * S)
    platform.give(3 * S, odometry_ns=2 * S)
    with refused(f"advance() gave odometry stamped 1.900 s, expected 2.000 s or later, as the one before ({PLACE})"):
        platform.give(3 * S, odometry_ns=1_900_000_000)
    platform.give(3 * S, odometry_ns=2_100_000_000)
    # With all its digits, where three are the same for both.
    with refused("stamped 2.099999999 s, expected 2.100000000 s or later"):
        platform.give(3 * S, odometry_ns=2_099_999_999)


def test_a_scan_may_repeat_its_stamp_but_not_go_back_and_each_sensor_has_its_own() -> None:
    platform = Platform()
    platform.give(2 * S, ears=scan(2 * S))
    platform.give(3 * S, ears=scan(2 * S), eye=sweep(S, 0))
    with refused("gave a scan of 'ears' stamped 1.999 s, expected 2.000 s or later"):
        platform.give(4 * S, ears=scan(1_999_000_000))
    platform.give(4 * S, ears=scan(3 * S))
    with refused("gave a scan of 'eye' stamped 0.500 s, expected 1.000 s or later"):
        platform.give(4 * S, eye=sweep(S // 2, 0))


def test_a_reading_of_range_max_or_more_becomes_no_echo() -> None:
    """Of the sonars the second and the third; of the sweep all. The rest of the answer is as it was given."""
    none, readings = np.zeros(4), np.array([3.99, 4.0, 5.0, math.inf])
    ears = RangeScan(S, np.zeros((4, 2)), none, none, none, readings, 0.1, 4.0)
    eye = replace(sweep(S, 0), ranges=np.full((1, 1), 4.0))
    answer = PlatformOutput(Odometry(S, ORIGIN, STILL), {"ears": ears, "eye": eye}, Contact(False), None)
    let = Platform().door.check(answer, PlatformInput(STILL, None, S))
    assert let.scans["ears"].ranges.tolist() == [3.99, math.inf, math.inf, math.inf]
    assert let.scans["eye"].ranges.tolist() == [[math.inf]]
    assert replace(let, scans=answer.scans) == answer


def test_stamps_may_be_a_second_ahead_of_the_run_clock() -> None:
    platform = Platform()
    platform.give(2 * S, odometry_ns=3 * S, ears=scan(3 * S))
    with refused("gave odometry stamped 3.100 s, expected run clock in ns, which is at 2.099 s; wall-clock"):
        platform.give(2_099_000_000, odometry_ns=3_100_000_000)
    with refused("gave a scan of 'ears' stamped 3.000 s, expected run clock in ns, which is at 2.000 s"):
        Platform().give(2 * S - 1, ears=scan(3 * S))


def test_after_a_restart_of_the_run_clock_stamps_begin_again() -> None:
    platform = Platform()
    platform.give(9 * S, ears=scan(9 * S))
    platform.give(S, ears=scan(S))
    with refused("gave odometry stamped 0.900 s, expected 1.000 s or later"):
        platform.give(S, odometry_ns=900_000_000)
    with refused("gave a scan of 'ears' stamped 0.900 s, expected 1.000 s or later"):
        platform.give(S, ears=scan(900_000_000))


def test_the_first_stamps_may_be_0_at_the_start_and_after_a_restart() -> None:
    platform = Platform()
    for now in (9 * S, S):
        platform.give(now, odometry_ns=0, ears=scan(0), eye=sweep(0, 0))
        platform.give(now, ears=scan(now), eye=sweep(now, 0))


def test_a_scan_whose_limits_are_equal_could_hold_no_echo() -> None:
    with refused("range_min 4 and range_max 4, expected range_max above range_min"):
        Platform().give(0, ears=scan(0, 4.0, 4.0))
    with refused("range_min 4.5 and range_max 4, expected"):
        Platform().give(0, ears=scan(0, 4.5, 4.0))


def test_each_scan_of_a_tick_is_checked() -> None:
    with refused("gave a scan of 'nose', expected one of ears, eye"):
        Platform().give(0, ears=scan(0), nose=scan(0))
    with refused("gave RangeScan for the sensor 'eye', expected Sweep"):
        Platform().give(0, ears=scan(0), eye=scan(0))
    with refused("gave 7 for the sensor 'ears', expected RangeScan"):
        Platform().give(0, ears=7)
    bare = PlatformDoor(Plugin("platform"), [])  # type: ignore[arg-type]
    answer = PlatformOutput(Odometry(0, ORIGIN, STILL), {"ears": scan(0)}, Contact(False), None)
    with refused("gave a scan of 'ears', expected one of no sensors"):
        bare.check(answer, PlatformInput(STILL, None, 0))


def test_a_sensor_of_a_kind_without_a_type_may_give_any_message() -> None:
    door = PlatformDoor(Plugin("platform"), [SensorSpec("nose", "smell")])  # type: ignore[arg-type]
    given = PlatformInput(STILL, None, 2 * S)
    for stamp in (2 * S, S):  # of a message that is no scan the stamp is not looked at
        reading = Odometry(stamp, ORIGIN, STILL)
        door.check(PlatformOutput(Odometry(2 * S, ORIGIN, STILL), {"nose": reading}, Contact(False), None), given)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("odometry", None, "gave odometry=None, expected Odometry"),
        ("contact", False, "gave contact=False, expected Contact: Contact(False) for no contact"),
        ("truth", 3, "gave truth=3, expected Truth or None"),
        ("scans", [], "gave scans=[], expected messages by sensor name, as {'laser': scan}"),
    ],
)
def test_each_part_of_a_platforms_answer_has_its_type(name: str, value: object, text: str) -> None:
    parts = {"odometry": Odometry(0, ORIGIN, STILL), "scans": {}, "contact": Contact(False), "truth": None}
    answer = object.__new__(PlatformOutput)
    for part, held in {**parts, name: value}.items():
        object.__setattr__(answer, part, held)
    with refused(text):
        Platform().door.check(answer, PlatformInput(STILL, None, 0))


def test_a_platform_may_know_the_truth_and_give_any_mapping() -> None:
    truth = Truth(ORIGIN, STILL, math.inf, "", False)
    scans = MappingProxyType({"ears": scan(0)})
    answer = PlatformOutput(Odometry(0, ORIGIN, STILL), scans, Contact(False), truth)
    assert Platform().door.check(answer, PlatformInput(STILL, None, 0)) is answer
    with refused("advance() returned None, expected PlatformOutput"):
        Platform().door.check(None, PlatformInput(STILL, None, 0))


# --- localizer --------------------------------------------------------------------------------------------------------


def pose(stamp_ns: int, *variances: float) -> PoseEstimate:
    return PoseEstimate(stamp_ns, ORIGIN, STILL, np.diag(variances or (0.0, 0.0, 0.0)))


def test_a_pose_has_the_stamp_of_the_odometry_and_no_negative_variance() -> None:
    door = LocalizerDoor(Plugin("localizer"))  # type: ignore[arg-type]
    given = LocalizerInput(Odometry(2 * S, ORIGIN, STILL), (), None)
    for good in (pose(2 * S), pose(2 * S, 0.1, 0.0, 0.2)):
        assert door.check(good, given) is good
    for stamp in (2 * S + 1, 2 * S - 1):
        told = "2.000000001" if stamp > 2 * S else "1.999999999"
        with refused(f"gave a pose stamped {told} s, expected the odometry's stamp, 2.000"):
            door.check(pose(stamp), given)
    for variances in ((-0.1, 0.2, 0.2), (0.2, -0.1, 0.2), (0.2, 0.2, -0.1)):
        with refused(f"gave variances {list(variances)}, expected values of at least 0"):
            door.check(pose(2 * S, *variances), given)
    with refused("returned 5, expected PoseEstimate"):
        door.check(5, given)


# --- mapper -----------------------------------------------------------------------------------------------------------


def map_of(stamp_ns: int, shape: tuple[int, int] = (2, 3), resolution: float = 0.2) -> MapUpdate:
    grid = OccupancyGrid(np.zeros(shape, dtype=np.int8), resolution, ORIGIN)
    return MapUpdate(stamp_ns, grid, np.empty((0, 4)), ())


def update(door: MapperDoor, now_ns: int, answer: object) -> object:
    return door.check(answer, MapperInput(now_ns, (), (), SimpleNamespace()))  # type: ignore[arg-type]


def test_a_map_may_be_a_second_older_than_the_one_before_and_a_second_ahead() -> None:
    door = MapperDoor(Plugin("mapper"))  # type: ignore[arg-type]
    assert update(door, 4 * S, None) is None
    for stamp in (5 * S, 4 * S, 3 * S):
        made = map_of(stamp)
        assert update(door, 4 * S, made) is made
    update(door, 4 * S, map_of(5 * S))
    with refused(
        "gave a map stamped 3.999 s, expected the stamp of its newest data, which was 5.000 s in the map before"
    ):
        update(door, 4 * S, map_of(3_999_000_000))
    with refused("gave a map stamped 5.001 s, expected run clock in ns, which is at 4.000 s"):
        update(door, 4 * S, map_of(5_001_000_000))


def test_after_a_restart_of_the_run_clock_maps_begin_again() -> None:
    door = MapperDoor(Plugin("mapper"))  # type: ignore[arg-type]
    update(door, 9 * S, map_of(9 * S))
    update(door, 3 * S, None)
    update(door, 4 * S, map_of(2 * S))
    with refused("which was 2.000 s in the map before"):
        update(door, 5 * S, map_of(S // 2))


def test_a_map_has_cells() -> None:
    door = MapperDoor(Plugin("mapper"))  # type: ignore[arg-type]
    with refused("gave a grid of shape (0, 3), expected at least one cell, or None for no map"):
        update(door, 0, map_of(0, (0, 3)))
    with refused("returned 5, expected MapUpdate or None"):
        update(door, 0, 5)


# --- planner ----------------------------------------------------------------------------------------------------------

ASKED = PlanRequest(7, Pose2D(1.0, 2.0, 0.0), Pose2D(4.0, -2.0, 1.0))


def path(start: tuple[float, float], end: tuple[float, float], fine: bool = False, number: int = 7) -> Path:
    grid = map_of(0, resolution=0.1).grid if fine else None
    return Path(number, np.array([start, (9.0, 9.0), end]), 5.0, grid)


def plan(answer: object, tolerance: float = 0.25, resolution: float = 0.1) -> object:
    door = PlannerDoor(Plugin("planner"), tolerance)  # type: ignore[arg-type]
    return door.check(answer, PlannerInput(ASKED, map_of(0, resolution=resolution)))


def test_a_path_starts_and_ends_as_asked_within_the_tolerance() -> None:
    for good in (path((1.0, 2.0), (4.0, -2.0)), path((1.14, 2.2), (3.86, -1.8)), path((1.0, 1.75), (4.25, -2.0))):
        assert plan(good) is good
    with refused("gave a path that starts at (1.16, 2.20), expected (1.00, 2.00), as asked, within 0.25 m"):
        plan(path((1.16, 2.2), (4.0, -2.0)))
    with refused("gave a path that ends at (4.00, -1.74), expected (4.00, -2.00), as asked, within 0.25 m"):
        plan(path((1.0, 2.0), (4.0, -1.74)))


@pytest.mark.parametrize(("resolution", "fine", "slack"), [(0.2, False, 0.28), (0.2, True, 0.14)])
def test_a_path_may_be_off_by_the_diagonal_of_a_cell_of_its_grid(resolution: float, fine: bool, slack: float) -> None:
    plan(path((1.0 + slack, 2.0), (4.0, -2.0), fine), 0.05, resolution)
    with refused(f"within {slack:.2f} m"):
        plan(path((1.01 + slack, 2.0), (4.0, -2.0), fine), 0.05, resolution)


def test_an_answer_has_the_number_of_its_request() -> None:
    failure = PlanFailure(7, "outside_map", Point2D(0.0, 0.0), "")
    assert plan(failure) is failure
    for number in (6, 8):
        for answer in (
            path((1.0, 2.0), (4.0, -2.0), number=number),
            PlanFailure(number, "outside_map", Point2D(0.0, 0.0), ""),
        ):
            with refused(f"answered request {number}, expected request 7, which was asked"):
                plan(answer)
    with refused("returned None, expected Path or PlanFailure"):
        plan(None)


def headed(heading: float) -> Path:
    """A path from (1, 2) to (4, -2), which leads in the direction -0.927 rad."""
    return Path(7, np.array([[1.0, 2.0], [4.0, -2.0]]), 5.0, None, np.full(2, heading))


@pytest.mark.parametrize("heading", [-0.927, -0.927 + math.pi, -0.927 + 0.78, -0.927 + math.pi - 0.78])
def test_a_path_with_headings_leads_forwards_or_backwards(heading: float) -> None:
    answer = headed(heading)
    assert plan(answer) is answer


def test_only_a_holonomic_robot_is_led_sideways() -> None:
    with refused("gave a path with headings whose segment 0 lies 53° off its heading, expected at most 45°"):
        plan(headed(0.0))
    robot = SimpleNamespace(drive="holonomic")
    door = PlannerDoor(Plugin("planner"), 0.25, robot)  # type: ignore[arg-type]
    door.check(headed(0.0), PlannerInput(ASKED, map_of(0)))


# --- commands ---------------------------------------------------------------------------------------------------------


def tracking(vx: float, wz: float) -> TrackingCommand:
    return TrackingCommand(Twist2D(vx, 0.0, wz), 0.0, 0.0, 0.0)


def chaser(linear: float = 0.5, angular: float = 0.4) -> TwistDoor[TrackingCommand]:
    plugin: Any = Plugin("controller")
    plugin.context = SimpleNamespace(robot=SimpleNamespace(max_linear=linear, max_angular=angular))
    return TwistDoor(plugin, TrackingCommand)


@pytest.mark.parametrize(
    ("vx", "wz", "note"),
    [
        (4.9, 3.9, ""),
        (-4.9, -3.9, ""),
        (0.1, 4.0, "10 times the turn limit: degrees? It gave 4 rad/s of 0.4"),
        (0.1, -6.0, "15 times the turn limit: degrees? It gave -6 rad/s of 0.4"),
        (5.0, 0.1, "10 times the speed limit. It gave 5 m/s of 0.5"),
        (-7.0, 0.1, "14 times the speed limit. It gave -7 m/s of 0.5"),
        (7.5, 6.0, "15 times the turn limit: degrees? It gave 6 rad/s of 0.4"),
        (8.0, 6.0, "16 times the speed limit. It gave 8 m/s of 0.5"),
    ],
)
def test_a_command_ten_times_beyond_a_limit_is_noted(vx: float, wz: float, note: str) -> None:
    door = chaser()
    command = tracking(vx, wz)
    assert door.check(command) is command
    assert door.notes == ([f"asked for {note} ({PLACE}); the gate limits it"] if note else [])
    assert doors.notes_of(SimpleNamespace(door=door)) is door.notes


def test_only_the_first_command_far_beyond_a_limit_is_noted() -> None:
    door = chaser()
    for wz in (0.1, 5.0, 9.0):
        door.check(tracking(0.1, wz))
    assert len(door.notes) == 1 and "It gave 5 rad/s" in door.notes[0]


def test_a_plugin_that_keeps_no_context_has_no_limits() -> None:
    door = TwistDoor(Plugin("controller"), TrackingCommand)  # type: ignore[arg-type]
    door.check(tracking(1e9, 1e9))
    assert door.notes == []


def test_a_role_gives_its_own_kind_of_command() -> None:
    with refused("control() returned Twist2D(vx=0.0, vy=0.0, wz=0.0), expected TrackingCommand"):
        chaser().check(STILL)
    with refused("expected RecoveryStep"):
        TwistDoor(Plugin("controller"), RecoveryStep).check(tracking(0.1, 0.1))  # type: ignore[arg-type]


def test_a_node_without_a_door_has_no_notes() -> None:
    assert doors.notes_of(object()) == [] and doors.notes_of(SimpleNamespace(door=object())) == []


def test_the_place_of_a_verb_is_its_line_and_empty_where_it_has_no_source() -> None:
    assert doors.verb_place(Plugin("planner")) == PLACE  # type: ignore[arg-type]

    class Compiled(Plugin):
        plan = abs  # type: ignore[assignment]

    assert doors.verb_place(Compiled("planner")) == ""  # type: ignore[arg-type]
    door = PlannerDoor(Compiled("planner"), 0.25)  # type: ignore[arg-type]
    with pytest.raises(AnswerError, match=r"expected Path or PlanFailure$"):
        door.check(None, PlannerInput(ASKED, map_of(0)))
