"""The README's example is valid, and its equation table names functions that exist."""

import re
import tomllib
from pathlib import Path

from navloom_mppi.adapter import Mppi
from navloom_mppi.params import MppiParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["avoider"]
    assert table.pop("plugin") == Mppi.name
    MppiParams(**table)


def test_every_function_of_the_equation_table_exists():
    found = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("## Choices")[0])
    assert len(found) > 20
    for module, name in found:
        assert hasattr(__import__(f"navloom_mppi.{module}", fromlist=[name]), name), f"{module}.{name}"
