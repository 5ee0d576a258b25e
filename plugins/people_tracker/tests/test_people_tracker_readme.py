"""The README's example is valid, and its table holds every parameter with its default."""

import re
import tomllib
from pathlib import Path

from navloom_people_tracker.adapter import PeopleTracker
from navloom_people_tracker.params import PeopleTrackerParams

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_every_parameter_is_listed_with_its_default() -> None:
    rows = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", README, re.MULTILINE)
    assert {name: float(text) for name, text in rows} == PeopleTrackerParams().model_dump()


def test_the_example_is_a_valid_node() -> None:
    (table,) = tomllib.loads(re.findall(r"```toml\n(.*?)```", README, re.DOTALL)[0])["node"]
    assert table["plugin"] == PeopleTracker.name
