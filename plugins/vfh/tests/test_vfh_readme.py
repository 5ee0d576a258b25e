"""The README's examples are valid, and its equation table names functions that exist."""

import re
import tomllib
from pathlib import Path

from navloom_vfh.adapter import Vfh, VfhPlus, VfhStar, VfhSwept

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
ALL = (Vfh, VfhPlus, VfhStar, VfhSwept)


def test_each_example_is_a_valid_table():
    blocks = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
    for block in blocks:
        table = tomllib.loads(block)["avoider"]
        name = table.pop("plugin")
        next(method for method in ALL if method.name == name).Params(**table)
    assert len(blocks) >= 1


def test_every_function_of_the_equation_table_exists():
    named = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("## Choices")[0])
    for module, name in named:
        package = "navloom.avoidance" if module in ("search", "himm", "points") else "navloom_vfh"
        assert hasattr(__import__(f"{package}.{module}", fromlist=[name]), name), f"{module}.{name}"
    assert len(named) > 15
