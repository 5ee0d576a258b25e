"""`navloom bench --page`: every figure is on the page, and docs/performance.md is such a page."""

from __future__ import annotations

from pathlib import Path

import navloom_benchmarks.page
from navloom_benchmarks.page import page

FOUND = {
    "machine": {"cpu": "Some CPU", "cpus": 2, "load": 0.1, "python": "3.11.2", "versions": {"numpy": "2.1.0"}},
    "quick": False,
    "rows": [
        {"name": "a tick", "ours": 0.41234, "unit": "ms", "peer": "real time", "theirs": 50.0, "ratio": 121.3,
         "low": 119.9, "high": 122.04, "note": "robot time over CPU time"},
        {"name": "plan()", "ours": 9.0, "unit": "ms", "peer": "pyastar2d", "theirs": None, "ratio": None,
         "low": None, "high": None, "note": ""},
    ],
    "left_out": {"barn": "it needs a file"},
}  # fmt: skip
DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "performance.md"


def test_a_page_has_machine_date_figures_notes_and_what_was_left_out() -> None:
    lines = page(FOUND, "2026-11-23").splitlines()
    assert lines[0] == "# Performance"
    assert "| date | 2026-11-23 |" in lines and "| processor | Some CPU, 2 CPUs |" in lines
    assert "| a tick | 0.4123 | 50 | ms | 121.3 | 120 to 122 | real time |" in lines
    assert "| plan() | 9 |  | ms |  |  | pyastar2d |" in lines
    assert lines[-2:] == ["- a tick: robot time over CPU time", "- Left out: barn: it needs a file"]


def test_a_page_of_quick_figures_says_so() -> None:
    assert "**Made with `--quick`" in page({**FOUND, "quick": True}, "2026-11-23")


def test_docs_performance_md_was_written_by_this_code_from_a_full_measurement() -> None:
    text = DOCUMENT.read_text("utf-8")
    assert text.startswith(navloom_benchmarks.page.HEAD) and "--quick`:" not in text
    assert f"| {' | '.join(navloom_benchmarks.page.COLUMNS)} |" in text
