"""The README's examples are valid, and its equation table names functions that exist."""

import re
import tomllib
from pathlib import Path

from navloom_trackers.adapter import FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
TRACKERS = {cls.name: cls for cls in (FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit)}


def test_the_examples_are_valid_tables():
    blocks = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
    assert blocks
    for block in blocks:
        table = tomllib.loads(block)["controller"]
        TRACKERS[table.pop("plugin")].Params(**table)


def test_every_function_of_the_equation_table_exists():
    named = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("## Choices")[0])
    assert len(named) > 15
    for module, name in named:
        assert hasattr(__import__(f"navloom_trackers.{module}", fromlist=[name]), name), f"{module}.{name}"
