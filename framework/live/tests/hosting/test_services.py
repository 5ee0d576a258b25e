"""Requests to a node that is busy: refused and never done, or done when its step ends."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest
from navloom.engine.nodes.localizer_node import LocalizerNode
from navloom.engine.task_checks import PlaceProblem
from navloom_live.hosting import node_services
from navloom_live.hosting.node_services import ServiceError, Services
from navloom_live.live.requests import Place, Placed, SpeedLimit


class Runner:
    """A node whose thread handles its requests when the test says so."""

    cell = SimpleNamespace(source=("planner", "astar"))

    def __init__(self) -> None:
        self.waiting: list[Any] = []

    def change(self, change: Any) -> None:
        self.waiting.append(change)


@pytest.fixture
def runner(monkeypatch: pytest.MonkeyPatch) -> Runner:
    monkeypatch.setattr("navloom_live.hosting.node_services.APPLY_WAIT", 0.05)
    return Runner()


def apply(runner: Runner, change: Any, **how: bool) -> None:
    Services._apply(object.__new__(Services), runner, change, **how)  # type: ignore[arg-type]


def test_a_request_that_a_node_does_not_handle_in_time_is_refused_and_never_done(runner: Runner) -> None:
    done: list[str] = []
    with pytest.raises(ServiceError, match=r"planner astar has been in one step for .*: nothing was changed"):
        apply(runner, lambda: done.append("set"))
    runner.waiting.pop()()
    assert done == []


def test_a_stop_is_done_however_late_the_node_handles_it(runner: Runner) -> None:
    done: list[str] = []
    with pytest.raises(ServiceError, match="the request is done when this step ends"):
        apply(runner, lambda: done.append("stop"), waits=True)
    runner.waiting.pop()()
    assert done == ["stop"]


@pytest.mark.parametrize(
    ("asked", "expected"),
    [(SpeedLimit(0.3), 0.3), (SpeedLimit(50.0, True), 0.2), (SpeedLimit(100.0, True), 0.0), (SpeedLimit(0.0), 0.0)],
)
def test_a_speed_limit_in_percent_is_one_of_the_usual_speed(
    monkeypatch: pytest.MonkeyPatch, asked: SpeedLimit, expected: float
) -> None:
    """Usually the robot drives at 0.4 m/s."""
    monkeypatch.setattr(node_services, "goal_rules", lambda system: SimpleNamespace(cruise=0.4))
    services: Any = object.__new__(Services)
    services._system, services._apply = None, lambda runner, change: change()
    gate = SimpleNamespace(speed_limit=9.0)
    runner: Any = SimpleNamespace(gate=SimpleNamespace(gate=gate))
    assert services._limit(runner, asked) == SpeedLimit(expected) and gate.speed_limit == expected


@pytest.mark.parametrize("speed", [-0.1, float("nan"), float("inf")])
def test_a_speed_limit_that_is_none_is_refused(speed: float) -> None:
    services: Any = object.__new__(Services)
    with pytest.raises(ServiceError, match=f"rejected: speed limit is {speed}, expected 0 for none, or more"):
        services._limit(None, SpeedLimit(speed))


@pytest.mark.parametrize(("is_outside", "is_refused"), [(True, True), (False, False)])
def test_only_a_pose_outside_the_world_is_refused_whatever_its_text_says(
    monkeypatch: pytest.MonkeyPatch, is_outside: bool, is_refused: bool
) -> None:
    problem = PlaceProblem("the robot does not fit: occupied by outside wall", is_outside)
    monkeypatch.setattr(node_services, "place_problem", lambda *_: problem)
    services: Any = object.__new__(Services)
    services._system, services._apply = None, lambda runner, change: None
    runner: Any = SimpleNamespace(cell=SimpleNamespace(node=object.__new__(LocalizerNode)))
    if is_refused:
        with pytest.raises(ServiceError, match="occupied by outside wall"):
            services._place(runner, Place(1.0, 2.0, 0.0))
    else:
        assert services._place(runner, Place(1.0, 2.0, 0.0)) == Placed(True, problem.text)


def test_a_request_that_a_node_has_begun_is_not_refused(runner: Runner) -> None:
    begun, go_on, done = threading.Event(), threading.Event(), threading.Event()

    def change() -> None:
        begun.set()
        go_on.wait(10)
        done.set()

    runner.change = lambda change: threading.Thread(target=change).start()  # type: ignore[method-assign]
    with pytest.raises(ServiceError, match="the request is done when this step ends"):
        apply(runner, change)
    assert begun.is_set()
    go_on.set()
    assert done.wait(10)
