"""The README's example is valid, and its table has every parameter with its default and printed value."""

import re
import tomllib
from pathlib import Path

from navloom_vff.adapter import Vff
from navloom_vff.params import VffParams, paper_literal

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def value(text):
    """Value of a cell of the table."""
    if text in ("true", "false"):
        return text == "true"
    return text if text.isalpha() else float(text)


def rows():
    table = README.partition("## Parameters")[2].partition("## Measured")[0]
    return re.findall(r"^\| `(\w+)` \| (\S+) \| (\S*) ?\|", table, re.MULTILINE)


def test_every_parameter_is_listed_with_its_default():
    assert {name: value(default) for name, default, _ in rows()} == VffParams().model_dump()


def test_the_printed_values_are_those_of_paper_literal():
    assert {name: value(printed) for name, _, printed in rows() if printed} == paper_literal()


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
