"""Changes of parameters while plugins run: all together or none."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.making import configure, make_plugins
from navloom.engine.system import System
from navloom.plugins import PluginError
from navloom_live.hosting.services import ServiceError, Services


def paper(*changes: str) -> System:
    system = assemble(load_config("paper", changes))
    make_plugins(system, only={("mapper", "ipabd@printed")})
    return system


def test_a_change_that_a_plugin_refuses_changes_no_parameter() -> None:
    system = paper()
    mapper = system.plugin("mapper", "ipabd@printed")
    before = dict(vars(mapper))
    with pytest.raises(ConfigError, match=r"mapper \(ipabd\): .*floor_tolerance"):
        configure(system, "mapper", "ipabd@printed", ("accumulate = false", "floor_tolerance = 2.0"))
    assert vars(mapper) == before and mapper.params.accumulate
    configure(system, "mapper", "ipabd@printed", ("accumulate = false",))
    assert not mapper.params.accumulate


def test_a_plugin_that_fails_in_configure_is_blamed_and_keeps_its_old_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    system = paper()
    mapper = system.plugin("mapper", "ipabd@printed")

    def breaks(params: Any) -> None:
        mapper.params = params
        raise ZeroDivisionError

    monkeypatch.setattr(mapper, "configure", breaks)
    before = mapper.params
    with pytest.raises(PluginError, match="ipabd fails in configure: ZeroDivisionError"):
        configure(system, "mapper", "ipabd@printed", ("accumulate = false",))
    assert mapper.params is before


def test_an_event_that_its_plugin_will_refuse_is_refused_before_the_run() -> None:
    event = "{ floor_tolerance = 2.0 }".join(('event=[{ at = 1.0, do = "set", role = "mapper", values = ', " }]"))
    with pytest.raises(ConfigError, match=r"event.0.values: mapper \(ipabd\): .*floor_tolerance"):
        paper(event)


def test_events_are_checked_in_order_of_time() -> None:
    later = '{ at = 20.0, do = "set", role = "mapper", values = { floor_tolerance = 2.0 } }'
    sooner = '{ at = 10.0, do = "set", role = "mapper", values = { z_limit = 3.0 } }'
    system = paper(f"event=[{later}, {sooner}]")
    assert (
        system.plugin("mapper", "ipabd@printed").params == system.parts[("mapper", "ipabd@printed")].params
    )  # they were only checked


class Runner:
    """A node whose thread handles its requests when the test says so."""

    cell = SimpleNamespace(source=("planner", "astar"))

    def __init__(self) -> None:
        self.waiting: list[Any] = []

    def change(self, change: Any) -> None:
        self.waiting.append(change)


@pytest.fixture
def runner(monkeypatch: pytest.MonkeyPatch) -> Runner:
    monkeypatch.setattr("navloom_live.hosting.services.APPLY", 0.05)
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
