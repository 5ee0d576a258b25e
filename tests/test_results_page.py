"""The page of results: it is what its command makes, and the command of a cell drives what the cell says."""

from __future__ import annotations

import html
import os
import random
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from navloom.config import ConfigError
from navloom.plugins import Discovery
from navloom_study.episode_rows import episode_row
from navloom_study.suites.result_file import as_result_row
from navloom_study.suites.results_page import results_page
from navloom_study.suites.results_store import stored_results
from navloom_study.suites.suite import Suite, suite_named
from navloom_study.suites.suite_run import plan_suite
from navloom_study.suites.verification import check_rows, is_same_machine

TOP = Path(__file__).resolve().parents[1]
STORED = TOP / "docs" / "results"
PAGE = TOP / "docs" / "results.md"
CELLS = 20
"""Number of cells whose commands are tried."""


def suite_of(name: str) -> Suite:
    try:
        return suite_named(name, Discovery())
    except ConfigError as error:
        if "NAVLOOM_DATA" in str(error) and not os.environ.get("NAVLOOM_DATA"):
            pytest.skip(str(error))
        raise


def test_the_page_is_what_the_command_makes() -> None:
    assert PAGE.read_text("utf-8") == results_page(STORED, PAGE.parent), "`navloom results page` makes it again"


def test_every_stored_summary_follows_from_its_rows() -> None:
    found = stored_results(STORED)
    assert found
    for result in found:
        check_rows(result)
        assert result.checked["bit_equal"]


def cells() -> Iterator[tuple[str, str]]:
    """Suite and method of a sample of the cells, by their commands."""
    commands = sorted(
        {html.unescape(text) for text in re.findall(r'<td[^>]* data-command="([^"]*)"', PAGE.read_text())}
    )
    for command in random.Random(46).sample(commands, CELLS):
        words = shlex.split(command)
        assert (words[:3], words[4]) == (["navloom", "compare", "--suite"], "--methods")
        yield words[3], words[5]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "method"), [*cells()])
def test_the_command_of_a_cell_drives_its_episodes(name: str, method: str) -> None:
    """The first episode of the command; where the cell has a result of this processor, it is that row bit for bit."""
    plan = plan_suite(suite_of(name), [method], {})
    key, task = next(iter(plan.tasks().items()))
    row = episode_row(task)
    assert row.outcome != "error", row.reason
    stored = [result for result in stored_results(STORED) if (result.suite, *result.methods) == (name, method)]
    for result in stored:
        if is_same_machine(result, plan):
            claimed = next(row for row in result.rows if row.key == key)
            assert as_result_row(row, key[1], result.metrics) == claimed
