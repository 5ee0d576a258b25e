"""The README's example is valid, its table has every parameter, and every function that it names exists."""

import importlib
import re
import tomllib
from pathlib import Path

from navloom_hybrid_astar.adapter import HybridAstar
from navloom_hybrid_astar.params import HybridAstarParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_every_parameter_is_listed_with_its_meaning():
    table = README.partition("<!-- parameters -->")[2].partition("<!-- end of parameters -->")[0]
    listed = dict(re.findall(r"^\| `(\w+)` \| [^|]+ \| ([^|]+) \|$", table, re.MULTILINE))
    assert listed == {key: field.description for key, field in HybridAstarParams.model_fields.items()}


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["planner"]
    assert table.pop("plugin") == HybridAstar.name
    HybridAstarParams(**table)


def test_every_function_of_the_table_exists():
    names = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("## Equations")[0])
    assert len(names) == 10
    for module, name in names:
        assert hasattr(importlib.import_module(f"navloom_hybrid_astar.{module}"), name), f"{module}.{name}"
