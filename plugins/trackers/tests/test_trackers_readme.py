"""The README's examples are valid, and its tables have every parameter with its default, and existing functions."""

import re
import tomllib
from pathlib import Path

from navloom_trackers.adapter import FierroLewis, Kanayama, PurePursuit, Ramsete

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
TRACKERS = {cls.name: cls for cls in (FierroLewis, Kanayama, PurePursuit, Ramsete)}


def value(text):
    """Value of a cell of the table; None for a default that depends on others."""
    if text in ("true", "false"):
        return text == "true"
    return None if text == "–" else float(text)


def listed(tracker):
    """Default by parameter, from the rows for all trackers and for one."""
    table = README.partition("## Parameters")[2].partition("## Measured")[0]
    rows = re.findall(r"^\| (\w+) \| `(\w+)` \| (\S+) \|", table, re.MULTILINE)
    return {name: value(default) for owner, name, default in rows if owner in ("all", tracker)}


def test_every_parameter_is_listed_with_its_default():
    for name, cls in TRACKERS.items():
        assert listed(name) == cls.Params().model_dump(), name


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
