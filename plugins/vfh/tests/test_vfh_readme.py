"""The README's examples are valid, and its table has every parameter with its defaults and printed values."""

import re
import tomllib
from pathlib import Path

import pytest
from navloom_vfh.adapter import Vfh, VfhPlus, VfhStar
from navloom_vfh.params import paper_literal

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
ALL = (Vfh, VfhPlus, VfhStar)
EACH = pytest.mark.parametrize("method", ALL, ids=[method.name for method in ALL])


def value(text):
    """Value of a cell of the table."""
    if text in ("true", "false"):
        return text == "true"
    return text if text.isalpha() else float(text)


def column(number):
    """Name and value of each row that has one in a column, counted from the name."""
    table = README.partition("## Parameters")[2].partition("## Measured")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if "| `" in line[:3]]
    return {row[0].strip("`"): value(row[number]) for row in rows if row[number]}


@EACH
def test_every_parameter_is_listed_with_its_default(method):
    assert column(1 + ALL.index(method)) == method.Params().model_dump()


def test_the_printed_values_are_those_of_paper_literal():
    literal = {}
    for method in ALL:
        literal |= paper_literal(method.name)
    assert column(4) == literal


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
        package = "navloom.avoidance" if module in ("search", "himm") else "navloom_vfh"
        assert hasattr(__import__(f"{package}.{module}", fromlist=[name]), name), f"{module}.{name}"
    assert len(named) > 15
