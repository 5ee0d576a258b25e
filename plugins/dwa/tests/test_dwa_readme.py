"""The README's example is valid, and its table has every parameter with its default and printed value."""

import re
import tomllib
from pathlib import Path

from navloom_dwa.adapter import Dwa
from navloom_dwa.params import DwaParams, fox_1997

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def value(name, text):
    """What a cell of the table says about a parameter."""
    if text in ("true", "false"):
        return text == "true"
    return text if isinstance(DwaParams.model_fields[name].default, str) else float(text)


def rows():
    table = README.partition("## Parameters")[2].partition("## Measured")[0]
    return re.findall(r"^\| `(\w+)` \| (\S+) \| (\S*) ?\|", table, re.MULTILINE)


def test_every_parameter_is_listed_with_its_default():
    assert {name: value(name, default) for name, default, _ in rows()} == DwaParams().model_dump()


def test_the_papers_values_are_those_of_fox_1997():
    assert {name: value(name, printed) for name, _, printed in rows() if printed} == fox_1997()


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["avoider"]
    assert table.pop("plugin") == Dwa.name
    DwaParams(**table)


def test_every_function_of_the_equation_table_exists():
    found = re.findall(r"`(\w+)\.(\w+)`", README.partition("## Where")[2].partition("## Choices")[0])
    assert len(found) > 20
    for module, name in found:
        assert hasattr(__import__(f"navloom_dwa.{module}", fromlist=[name]), name), f"{module}.{name}"
