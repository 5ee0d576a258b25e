"""The README's example is valid, its table has every parameter, and every function that it names exists."""

import importlib
import re
import tomllib
from pathlib import Path

from navloom_astar.adapter import AStar
from navloom_astar.params import AstarParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_every_parameter_is_listed():
    table = README.partition("## Parameters")[2].partition("## Speed")[0]
    listed = set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE))
    assert listed == set(AstarParams.model_fields)


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["planner"]
    assert table.pop("plugin") == AStar.name
    AstarParams(**table)


def test_every_function_of_the_table_exists():
    names = re.findall(r"`(\w+)\.(\w+)", README.partition("## Where")[2].partition("## Choices")[0])
    assert len(names) >= 10
    for module, name in names:
        assert hasattr(importlib.import_module(f"navloom_astar.{module}"), name), f"{module}.{name}"
