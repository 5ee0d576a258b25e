"""Requests to a node that is busy: refused and never done, or done when its step ends."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest
from navloom_live.hosting.node_services import ServiceError, Services


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
