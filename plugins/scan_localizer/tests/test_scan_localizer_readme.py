"""The README's example is valid, and its table holds every parameter with its default."""

import re
import tomllib
from pathlib import Path

from navloom_scan_localizer.adapter import ScanMatching
from navloom_scan_localizer.params import ScanMatchingParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_every_parameter_is_listed_with_its_default():
    rows = re.findall(
        r"^\| `(\w+)` \| (\S+) \|", README.partition("## Parameters")[2].partition("## Measured")[0], re.MULTILINE
    )
    listed = {name: {"true": True, "false": False}.get(text) if text.isalpha() else float(text) for name, text in rows}
    assert listed == ScanMatchingParams().model_dump()


def test_the_example_is_a_valid_table():
    table = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])["localizer"]
    assert table.pop("plugin") == ScanMatching.name
    ScanMatchingParams(**table)
