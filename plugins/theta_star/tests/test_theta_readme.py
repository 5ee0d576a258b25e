"""The README's example is valid and every function of its table exists."""

import importlib
import re
import tomllib
from pathlib import Path

from navloom_astar.params import AstarParams
from navloom_theta_star.adapter import LazyThetaStar, ThetaStar

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["planner"]
    assert table.pop("plugin") in (ThetaStar.name, LazyThetaStar.name)
    AstarParams(**table)


def test_every_function_of_the_table_exists():
    names = re.findall(r"`(navloom_\w+\.)?(\w+)\.(\w+)`", README.partition("## Where")[2].partition("## Choices")[0])
    assert len(names) >= 5
    for package, module, name in names:
        assert hasattr(importlib.import_module(f"{package or 'navloom_theta_star.'}{module}"), name), f"{module}.{name}"
