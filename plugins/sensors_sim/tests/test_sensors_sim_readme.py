"""The README's example is valid, and its tables have every parameter with its default."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from navloom_sensors_sim.params import (
    LaserSettings,
    PitchedLaserSettings,
    SensorsSimParams,
    SonarSettings,
    TrueTracksSettings,
)

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")
KINDS = {"pitched_laser": PitchedLaserSettings, "laser_2d": LaserSettings, "sonar_ring": SonarSettings,
         "true_tracks": TrueTracksSettings}  # fmt: skip


def test_example_is_accepted():
    (block,) = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
    tables = tomllib.loads(block)
    assert tables["platform"].pop("plugin") == "sensors_sim"
    SensorsSimParams(**tables["platform"])
    sensors = [dict(sensor) for sensor in tables["sensor"]]
    assert {sensor["kind"] for sensor in sensors} == set(KINDS) - {"true_tracks"}
    for sensor in sensors:
        sensor.pop("name")
        KINDS[sensor.pop("kind")](**sensor)


@pytest.mark.parametrize(
    "place, cls", [("`[platform]`:", SensorsSimParams)] + [(f'`kind = "{kind}"`:', cls) for kind, cls in KINDS.items()]
)
def test_table_holds_every_parameter(place, cls):
    table = README.split(place)[1].split("\n\n")[1]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|", table, re.MULTILINE))
    for key, field in cls.model_fields.items():
        text = rows.pop(key)
        assert (None if text == "none" else tomllib.loads(f"default = {text}")["default"]) == field.default, key
    assert not rows
