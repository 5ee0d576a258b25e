"""docs/frameworks.md is written from its statements; each has a source and a date, and old dates give a warning."""

from __future__ import annotations

import datetime
import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / "docs" / "site" / "frameworks.py"


@pytest.fixture(scope="module")
def frameworks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("frameworks", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def one(says: str, date: datetime.date) -> dict[str, Any]:
    """Statements about one framework in one subject; the second subject was searched on the same date."""
    names = {"peer": ["Peer", "https://peer.example", "1"]}
    subjects = [{"name": "ROS", "group": "Robots", "peer": [says, "a.md", date]}, {"name": "Zones", "group": "Robots"}]
    return {"searched": date, "frameworks": names, "repositories": {}, "subject": subjects}


def test_the_page_is_what_the_statements_give(frameworks: ModuleType) -> None:
    assert frameworks.PAGE.read_text("utf-8") == frameworks.page(frameworks.load())


def test_every_statement_has_a_source_and_a_date(frameworks: ModuleType) -> None:
    data = frameworks.load()
    statements = [one[key] for one in data["subject"] for key in data["frameworks"] if key in one]
    assert len(statements) >= 130
    for says, source, date in statements:
        url = frameworks.url_of(source, data)
        is_here = (frameworks.PAGE.parent / url).exists()
        assert says and isinstance(date, datetime.date), says
        assert is_here or re.fullmatch(r"https://[\w.-]+/\S*", url), source


def test_no_subject_names_an_unknown_framework(frameworks: ModuleType) -> None:
    data = frameworks.load()
    for subject in data["subject"]:
        assert subject.keys() <= {"name", "group", *data["frameworks"]}, subject["name"]


@pytest.mark.parametrize(("days", "warned"), [(0, False), (90, False), (91, True)])
def test_a_date_older_than_90_days_gives_a_warning(frameworks: ModuleType, days: int, warned: bool) -> None:
    read = datetime.date(2026, 11, 27)
    found = frameworks.stale(one("Yes", read), read + datetime.timedelta(days))
    assert found == (["Peer: read again, last on 2026-11-27 or later: ROS, Zones"] if warned else [])


def test_an_old_statement_beside_a_new_one_is_named_alone(frameworks: ModuleType) -> None:
    data = one("Yes", datetime.date(2026, 1, 1)) | {"searched": datetime.date(2026, 11, 27)}
    assert frameworks.stale(data, datetime.date(2026, 11, 28)) == ["Peer: read again, last on 2026-01-01 or later: ROS"]


def test_ci_asks_for_the_warnings_once_a_week() -> None:
    text = (SCRIPT.parents[2] / ".github" / "workflows" / "sources.yml").read_text("utf-8")
    assert "schedule:" in text and "python3 docs/site/frameworks.py --stale" in text


def test_warnings_fail_nothing() -> None:
    words = [sys.executable, str(SCRIPT), "--stale", "--today", "2100-01-01"]
    ran = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (ran.returncode, ran.stderr) == (0, "") and len(ran.stdout.splitlines()) >= 9


def test_a_framework_without_a_statement_is_listed_with_the_date_of_the_search(frameworks: ModuleType) -> None:
    text = frameworks.page(one("Partly: some", datetime.date(2026, 11, 27)))
    assert "| [ROS](#ros) | ◐ |" in text and "| [Zones](#zones) | – |" in text
    assert "Nothing found, 2026-11-27: Peer." in text
