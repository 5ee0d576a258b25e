"""Changes of parameters while plugins run: all together or none."""

from __future__ import annotations

from typing import Any

import pytest
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.plugin_factory import configure, make_plugins
from navloom.engine.system import System
from navloom.plugins import PluginError


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
    made = system.plugin("mapper", "ipabd@printed").params
    assert made == paper().plugin("mapper", "ipabd@printed").params  # they were only checked
