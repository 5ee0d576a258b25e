"""The README's example is valid, and its table holds every parameter with its default."""

import re
import tomllib
from pathlib import Path

import pytest
from navloom_scan_localizer.adapter import ScanMatching
from navloom_scan_localizer.params import ScanMatchingParams, ScanOdometryParams
from navloom_scan_localizer.scan_odometry.adapter import ScanOdometry

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


OF_SCAN_MATCHING = README.partition("## Parameters")[2].partition("## Measured")[0]
OF_SCAN_ODOMETRY = README.partition("## Without a map")[2]


@pytest.mark.parametrize(
    ("part", "params"), [(OF_SCAN_MATCHING, ScanMatchingParams), (OF_SCAN_ODOMETRY, ScanOdometryParams)]
)
def test_every_parameter_is_listed_with_its_default(part, params):
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \|", part, re.MULTILINE)
    listed = {name: {"true": True, "false": False}.get(text) if text.isalpha() else float(text) for name, text in rows}
    assert listed == params().model_dump()


def test_the_examples_are_valid_tables():
    given = [tomllib.loads(block)["localizer"] for block in re.findall(r"```toml\n(.*?)```", README, re.DOTALL)]
    for table, localizer in zip(given, (ScanMatching, ScanOdometry), strict=True):
        assert table.pop("plugin") == localizer.name
        localizer.Params(**table)
