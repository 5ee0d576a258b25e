"""The README's example is valid, and its equation table names functions that exist."""

import re
import tomllib
from pathlib import Path

from navloom_vff.adapter import Vff
from navloom_vff.params import VffParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["avoider"]
    assert table.pop("plugin") == Vff.name
    VffParams(**table)


def test_every_function_of_the_equation_table_exists():
    names = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("## Choices")[0])
    assert len(names) >= 15
    for module, name in names:
        package = "navloom.avoidance" if module == "himm" else "navloom_vff"
        assert hasattr(__import__(f"{package}.{module}", fromlist=[name]), name), f"{module}.{name}"
