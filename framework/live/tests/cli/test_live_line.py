"""Status line of a goal and of teleop: one rewritten line on a terminal, single lines elsewhere."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import pytest
from navloom.kernel_progress import Kernels
from navloom.messages import Feedback, GateStatus, GoalResult, Point2D, StopReason, Twist2D
from navloom_live.cli.live_line import LiveLine, goal_line
from navloom_live.cli.live_table import StatusTable
from navloom_live.cli.teleop import teleop_line
from navloom_live.operating.teleoperation import limit_in_words

DRIVES = GateStatus("controller", "law", False, False, None, ())
BLOCKED = GateStatus("controller", "law", False, False, None, (), 0.0, "obstacle", Point2D(0.4, 0.0), 0.4)
OPERATOR = GateStatus("operator", "main", False, False, None, ())


def stop(reason: str, latched: bool = False) -> GateStatus:
    return GateStatus("none", "", True, latched, StopReason.parse(reason), ())


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_the_line_is_rewritten_within_its_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    stream = Terminal()
    line = LiveLine(stream)
    line.show("driving, 3.00 m and 8 s left", "driving")
    line.show("driving", "driving")
    line.end()
    line.end()
    assert stream.getvalue() == "\r\x1b[Kdriving, 3.00 m and\r\x1b[Kdriving\n"


def test_a_text_from_outside_cannot_start_a_line_of_its_own() -> None:
    stream = io.StringIO()
    LiveLine(stream).show("searching, localizer lost: \n\x1b[2Jsucceeded", "searching")
    assert stream.getvalue() == "searching, localizer lost: \\n\\x1b[2Jsucceeded\n"


def test_elsewhere_a_line_comes_with_each_change_and_every_five_seconds() -> None:
    stream, now = io.StringIO(), [0.0]
    line = LiveLine(stream, lambda: now[0])
    for tick in range(24):  # 12 s of feedback
        now[0] = tick * 0.5
        line.show(f"{now[0]} s", "planning" if tick < 2 else "driving")
    line.end()
    assert stream.getvalue().split("\n") == ["0.0 s", "1.0 s", "6.0 s", "11.0 s", ""]


@pytest.mark.parametrize(
    ("feedback", "gate", "speed", "text"),
    [
        (Feedback(2, "driving", 3.6, 9.0, 0.04, 0), DRIVES, 0.396,
         "driving, 3.60 m and 9 s left, 0.40 m/s by controller, cross-track +0.04 m"),
        (Feedback(2, "driving", 3.6, 9.0, 0.04, 1), DRIVES, None,
         "driving, 3.60 m and 9 s left, by controller, recoveries 1, cross-track +0.04 m"),
        (Feedback(2, "driving", 0.0, 0.0, 0.0, 0), DRIVES, 0.4, "planning"),
        (Feedback(2, "planning", 0.0, 0.0, 0.0, 0), stop("no_trajectory"), 0.0, "planning; it waits for a path"),
        (Feedback(2, "driving", 3.6, 9.0, -0.004, 0), BLOCKED, -0.001,
         "driving, 3.60 m and 9 s left, 0.00 m/s by controller, cross-track +0.00 m; "
         "blocked: obstacle 0.40 m away, ahead"),
        (Feedback(2, "driving", 3.6, 9.0, 0.0, 0), replace(BLOCKED, share=0.5), 0.2,
         "driving, 3.60 m and 9 s left, 0.20 m/s by controller, cross-track +0.00 m; "
         "slowed: obstacle 0.40 m away, ahead"),
        (Feedback(2, "driving", 3.6, 9.0, 0.04, 0), stop("operator", True), 0.0,
         "driving, 3.60 m and 9 s left, cross-track +0.04 m; stopped: by an operator; "
         "`navloom resume` lets it drive again"),
        (Feedback(2, "mapping", 0.0, 0.0, 0.0, 0), None, None, "mapping"),
    ],
    ids=["driving", "no speed yet", "old path", "planning", "blocked", "slowed", "stopped", "no gate"],
)  # fmt: skip
def test_the_line_of_a_goal(feedback: Feedback, gate: GateStatus | None, speed: float | None, text: str) -> None:
    assert goal_line(feedback, gate, speed)[0] == text


def test_a_goal_gets_a_new_line_when_its_driver_changes_and_not_when_the_robot_moves() -> None:
    far, near = Feedback(2, "driving", 3.6, 9.0, 0.0, 0), Feedback(2, "driving", 3.4, 8.0, 0.0, 0)
    assert goal_line(far, DRIVES, 0.4)[1] == goal_line(near, DRIVES, 0.3)[1]
    avoider = GateStatus("avoider", "vfh", False, False, None, ())
    kinds = {goal_line(far, gate, 0.4)[1] for gate in (DRIVES, avoider, stop("contact"), stop("operator"))}
    assert len(kinds) == 4


def test_the_line_of_teleop_has_the_requested_commanded_and_measured_velocity() -> None:
    asked, gate, robot = (Twist2D(v, 0.0, math.radians(w)) for v, w in ((1.2, 40.0), (0.5, 25.0), (0.49, 24.0)))
    text = "asked +1.20 m/s +40 deg/s | gate +0.50 +25 | robot +0.49 +24"
    assert teleop_line(asked, gate, robot, "") == (text, "")
    assert teleop_line(asked, gate, robot, "limited: speed") == (f"{text} | limited: speed", "limited: speed")


def test_the_line_of_teleop_has_the_speed_to_the_left_of_a_robot_that_slides() -> None:
    asked, gate, robot = (Twist2D(0.0, vy, 0.0) for vy in (0.5, 0.3, 0.25))
    text = "asked +0.00, +0.50 m/s +0 deg/s | gate +0.00, +0.30 +0 | robot +0.00, +0.25 +0"
    assert teleop_line(asked, gate, robot, "")[0] == text


@pytest.mark.parametrize(
    ("asked", "granted", "before", "status", "words"),
    [
        ((0.3, 0.2), (0.3, 0.2), (0.3, 0.2), OPERATOR, ""),
        ((1.2, 0.2), (0.5, 0.2), (0.5, 0.2), OPERATOR, "limited: speed"),
        ((1.2, 0.2), (0.3, 0.2), (0.275, 0.2), OPERATOR, "limited: acceleration"),
        ((0.3, 0.7), (0.3, 0.4), (0.3, 0.4), OPERATOR, "limited: turn rate"),
        ((0.3, 0.7), (0.1, 0.4), (0.05, 0.4), None, "limited: acceleration, turn rate"),
        ((0.3, 0.0), (0.0, 0.0), (0.0, 0.0), stop("contact", True), "stopped: it touched something"),
        ((0.3, 0.0), (0.0, 0.0), (0.0, 0.0), stop("no_trajectory"), "not taken yet"),
        ((0.3, 0.0), (0.2, 0.0), (0.2, 0.0), DRIVES, "controller law drives"),
    ],
    ids=["free", "speed", "acceleration", "turn", "both", "contact", "at first", "another"],
)
def test_the_line_names_a_limit_of_the_gate(
    asked: tuple[float, float],
    granted: tuple[float, float],
    before: tuple[float, float],
    status: GateStatus | None,
    words: str,
) -> None:
    twists = [Twist2D(vx, 0.0, wz) for vx, wz in (asked, granted, before)]
    assert limit_in_words(*twists, status) == words


class Run:
    """A run as `navloom up` shows it."""

    def __init__(self) -> None:
        self.feedback: Feedback | None = None
        self.status: GateStatus | None = None
        self.result: GoalResult | None = None


def test_up_says_how_many_nodes_are_up_and_which_kernel_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    now, said = [0.0], []
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    table = StatusTable(Run(), io.StringIO(), said.append)
    for now[0], kernels in ((0.0, Kernels()), (5.0, Kernels(9, 9, 40)), (11.0, Kernels(10, 12, 40))):
        table.missing([("planner", "astar")], 8, kernels)
    assert said == [
        "starting; the first run compiles kernels, later ones load them",
        "7 of 8 nodes are up, kernel 12 of 40; waiting for planner astar",
    ]


def test_up_prints_the_start_progress_and_end_of_a_goal_and_no_fault() -> None:
    run, stream, said = Run(), io.StringIO(), []
    with StatusTable(run, stream, said.append) as table:
        for run.feedback, run.status in (
            (None, stop("no_trajectory")),
            (Feedback(1, "planning", 0.0, 0.0, 0.0, 0), stop("no_trajectory")),
            (Feedback(1, "driving", 3.0, 8.0, 0.0, 0), DRIVES),
            (Feedback(1, "driving", 3.0, 8.0, 0.0, 0), stop("operator", True)),
        ):
            table.look(None)
        run.feedback, run.status = Feedback(0, "idle", 0.0, 0.0, 0.0, 0), stop("no_trajectory")
        run.result = GoalResult(1, "succeeded", "the goal was reached", Point2D(0.0, 0.0))
        table.look(None)
    assert said == [
        "stopped: no goal",
        "goal 1: planning",
        "goal 1: driving; controller law drives",
        "goal 1: driving; stopped: by an operator",
        "stopped: goal reached",
    ]
