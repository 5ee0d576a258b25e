"""What an operator does to a robot, by the requests that are sent."""

from __future__ import annotations

import math
from typing import Any

import pytest
from navloom.messages import GateStatus, StopReason
from navloom_live.live.description import Description
from navloom_live.live.requests import Placed, Planned
from navloom_live.live.service import Service
from navloom_live.operating import operator_actions
from navloom_live.operating.client import ClientError, Refused
from navloom_live.operating.teleoperation import Driver

from .described import BusInWords, client, described, everyone


class Robot:
    """Stands for a client. `asked` lists the requests; those in `refused` are refused."""

    class keys:
        prefix = "lab/r1"

    def __init__(self, *localizers: tuple[str, bool], refused: str = "", warning: str = "") -> None:
        self._there = [described("localizer", name, active=active) for name, active in localizers]
        self._refused, self._warning = refused, warning
        self.asked: list[tuple[Any, ...]] = []

    def describe(self) -> list[Description]:
        return [*self._there, described("gate", "main")]

    def call(self, role: str, instance: str, service: Service[Any, Any], asked: Any) -> Placed:
        if instance == self._refused:
            raise Refused(f"{role} {instance} does not accept a pose")
        given = [value for value in vars(asked).values() if value is not None]
        self.asked.append((role, instance, service.name, *given))
        return Placed(True, self._warning)


def place(robot: Robot, x: float = 1.0, y: float = -2.0, heading: float = 0.5) -> str:
    return operator_actions.place(robot, x, y, heading)  # type: ignore[arg-type]


def test_the_active_localizer_is_placed_first_and_then_the_goal_is_planned_again() -> None:
    robot = Robot(("odometry", False), ("scans", True))
    assert place(robot) == ""
    assert robot.asked == [
        ("localizer", "scans", "place", 1.0, -2.0, 0.5),
        ("localizer", "odometry", "place", 1.0, -2.0, 0.5),
        ("goal", "main", "replan"),
    ]


def test_a_guess_goes_to_every_localizer_with_its_standard_deviations() -> None:
    robot = Robot(("scans", True))
    operator_actions.place(robot, 1.0, -2.0, 0.5, (0.7, 0.25))  # type: ignore[arg-type]
    assert robot.asked == [("localizer", "scans", "place", 1.0, -2.0, 0.5, 0.7, 0.25), ("goal", "main", "replan")]


def test_the_active_localizer_searches_first_and_then_the_goal_is_planned_again() -> None:
    robot = Robot(("odometry", False), ("scans", True))
    operator_actions.relocalise(robot)  # type: ignore[arg-type]
    assert robot.asked == [
        ("localizer", "scans", "relocalise"),
        ("localizer", "odometry", "relocalise"),
        ("goal", "main", "replan"),
    ]


def test_an_active_localizer_that_accepts_no_pose_refuses_for_the_robot() -> None:
    robot = Robot(("odometry", False), ("scans", True), refused="scans")
    with pytest.raises(Refused, match="localizer scans does not accept a pose"):
        place(robot)
    assert robot.asked == []


def test_a_shadow_may_accept_no_pose() -> None:
    robot = Robot(("odometry", False), ("scans", True), refused="odometry")
    place(robot)
    assert [one[1] for one in robot.asked] == ["scans", "main"]


def test_a_place_where_the_robot_does_not_fit_is_taken_with_a_warning() -> None:
    assert place(Robot(("scans", True), warning="occupied by the map")) == "occupied by the map"


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_a_pose_that_is_not_finite_is_refused_before_anything_is_asked(wrong: float) -> None:
    robot = Robot(("scans", True))
    with pytest.raises(Refused, match=f"heading is {wrong}, expected a finite number"):
        place(robot, heading=wrong)
    assert robot.asked == []


def test_without_an_active_localizer_it_says_so() -> None:
    with pytest.raises(ClientError, match="no localizer answers"):
        place(Robot(("odometry", False)))


def test_the_active_planner_plans_and_the_active_mapper_clears() -> None:
    asked: list[tuple[Any, ...]] = []

    class Two(Robot):
        def describe(self) -> list[Description]:
            roles = [(role, name, name == "b") for role in ("planner", "mapper") for name in ("a", "b")]
            return [described(role, name, active=active) for role, name, active in roles]

        def call(self, role: str, instance: str, service: Service[Any, Any], given: Any) -> Any:
            asked.append((role, instance, service.name, *vars(given).values()))
            return Planned(((0.0, 0.0), (1.0, 0.0)))

    robot = Two()
    found = operator_actions.plan(robot, (0.0, 0.0, 0.0), (1.0, 0.0, 0.5))  # type: ignore[arg-type]
    operator_actions.clear_map(robot)  # type: ignore[arg-type]
    assert found.points == ((0.0, 0.0), (1.0, 0.0))
    assert asked == [("planner", "b", "plan", (0.0, 0.0, 0.0), (1.0, 0.0, 0.5)), ("mapper", "b", "clear")]


def test_a_swap_of_a_method_names_alternatives() -> None:
    class Without(Robot):
        def lives(self, role: str, instance: str) -> bool:
            return False

    with pytest.raises(Refused, match=r"neither shadowed nor swapped; \[\[alternative\]\] is for that"):
        operator_actions.swap(Without(), "method", "integrated")  # type: ignore[arg-type]


def test_teleop_names_the_stop_also_while_the_robot_still_brakes() -> None:
    driver = Driver(client(BusInWords(everyone())))
    driver._heed(GateStatus("none", "", False, True, StopReason("operator"), ()))
    with pytest.raises(ClientError, match=r"is stopped: by an operator; `navloom resume` lets it drive again"):
        driver._refuse_if_latched()
    driver._heed(GateStatus("none", "", True, False, StopReason("no_trajectory"), ()))
    driver._refuse_if_latched()
