"""The README's example is valid, and its tables have every parameter with its default, and existing functions."""

import re
import tomllib
from pathlib import Path

import pytest
from navloom_scan_grid.adapter import Layered, ScanGrid
from navloom_scan_grid.params import LayeredParams, ScanGridParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def value(text):
    """What a cell of the table says."""
    words = {"true": True, "false": False, "none": None}
    return words[text] if text in words else text if text.isalpha() else float(text)


SECTIONS = [("Parameters", "Measured", ScanGridParams), ("layered", "Parameters", LayeredParams)]


@pytest.mark.parametrize("heading, end, params", SECTIONS)
def test_every_parameter_is_listed_with_its_default_and_meaning(heading, end, params):
    table = README.partition(f"## {heading}")[2].partition(f"## {end}")[0]
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| (.*) \|$", table, re.MULTILINE)
    assert {name: value(default) for name, default, _ in rows} == params().model_dump()
    fields = params.model_fields
    assert {name: meaning for name, _, meaning in rows} == {name: fields[name].description for name in fields}


def test_the_examples_are_valid_tables():
    tables = [tomllib.loads(text)["mapper"] for text in re.findall(r"```toml\n(.*?)```", README, re.DOTALL)]
    assert [table.pop("plugin") for table in tables] == [ScanGrid.name, Layered.name]
    ScanGridParams(**tables[0])
    LayeredParams(**tables[1])


def test_every_function_of_the_table_exists():
    named = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("Poses are")[0])
    assert len(named) >= 10
    for module, name in named:
        assert hasattr(__import__(f"navloom_scan_grid.{module}", fromlist=[name]), name), f"{module}.{name}"
