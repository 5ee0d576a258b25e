"""The README's example is valid, and its equation table names functions that exist."""

import re
import tomllib
from pathlib import Path

from navloom_orca.adapter import Orca
from navloom_orca.params import OrcaParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["avoider"]
    assert table.pop("plugin") == Orca.name
    OrcaParams(**table)


def test_every_function_of_the_equation_table_exists():
    found = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("## Choices")[0])
    assert len(found) >= 14
    for module, name in found:
        assert hasattr(__import__(f"navloom_orca.{module}", fromlist=[name]), name), f"{module}.{name}"
