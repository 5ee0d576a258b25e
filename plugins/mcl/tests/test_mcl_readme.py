"""The README's example is valid, and its table holds every parameter with its default."""

import re
import tomllib
from pathlib import Path

from navloom_mcl.adapter import Mcl
from navloom_mcl.global_matching.params import GlobalMatchingParams
from navloom_mcl.params import MclParams
from navloom_scan_localizer.params import ScanMatchingParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
OF_MCL = README.partition("## Parameters")[2].partition("\n## ")[0]


def test_every_parameter_is_listed_with_its_default():
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \|", OF_MCL, re.MULTILINE)
    listed = {name: {"true": True, "false": False}.get(text) if text.isalpha() else float(text) for name, text in rows}
    assert listed == MclParams().model_dump()


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.findall(r"```toml\n(.*?)```", README, re.DOTALL)[0])["localizer"]
    assert table.pop("plugin") == Mcl.name
    Mcl.Params(**table)


def test_every_parameter_of_the_search_is_listed_with_its_default():
    page = (Path(__file__).parents[1] / "global_matching.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", page, re.MULTILINE)
    own = {
        key: value
        for key, value in GlobalMatchingParams().model_dump().items()
        if key not in ScanMatchingParams.model_fields
    }
    assert {name: float(text) for name, text in rows} == own
