"""The README's example is valid, and its tables have every parameter with its default, and existing functions."""

import re
import tomllib
from pathlib import Path

from navloom_scan_grid.adapter import ScanGrid
from navloom_scan_grid.params import ScanGridParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def value(text):
    """What a cell of the table says."""
    words = {"true": True, "false": False, "none": None}
    return words[text] if text in words else text if text.isalpha() else float(text)


def test_every_parameter_is_listed_with_its_default_and_meaning():
    table = README.partition("## Parameters")[2].partition("## Measured")[0]
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| (.*) \|$", table, re.MULTILINE)
    assert {name: value(default) for name, default, _ in rows} == ScanGridParams().model_dump()
    fields = ScanGridParams.model_fields
    assert {name: meaning for name, _, meaning in rows} == {name: fields[name].description for name in fields}


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["mapper"]
    assert table.pop("plugin") == ScanGrid.name
    ScanGridParams(**table)


def test_every_function_of_the_table_exists():
    named = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("Poses are")[0])
    assert len(named) >= 10
    for module, name in named:
        assert hasattr(__import__(f"navloom_scan_grid.{module}", fromlist=[name]), name), f"{module}.{name}"
