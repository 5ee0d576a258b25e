"""Run chosen tests in this process, quickest first, and record what passed and what failed first."""

from __future__ import annotations

import contextlib
import math
import os
import resource
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import Phase, settings

__all__ = ["Outcomes", "run_tests"]

MEMORY = 8 << 30
"""Address space of a test process, bytes: a mutant may ask for any amount of memory."""


@dataclass
class Outcomes:
    """Results of one run.

    Attributes:
        passed: Tests that passed, and how long each took, s.
        failed: The first test that failed, or the file that could not be imported; empty for none.
        ran_long: Whether that test was stopped because it ran long.
    """

    passed: dict[str, float] = field(default_factory=dict)
    failed: str = ""
    ran_long: bool = False


BUDGET = 10.0
"""Time after which a run without a mutant starts no further test, as a multiple of the longest that one may take: the
tests that it did not reach are left out."""


class RanLong(BaseException):
    """A test ran longer than it may."""


class Watch:
    """A pytest plugin that chooses, orders, times and limits tests."""

    def __init__(self, chosen: dict[str, float] | None, slowest: float, compiling: float) -> None:
        self.chosen, self.slowest, self.compiling, self.outcomes = chosen, slowest, compiling, Outcomes()
        self._last = math.inf if chosen is not None else time.monotonic() + BUDGET * slowest

    def pytest_configure(self) -> None:
        phases = (Phase.explicit, Phase.generate)  # a failing example need not be made short
        settings.register_profile("mutants", derandomize=True, deadline=None, database=None, phases=phases)
        settings.load_profile("mutants")

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self.chosen is not None:
            items[:] = sorted((i for i in items if i.nodeid in self.chosen), key=lambda i: self.chosen[i.nodeid])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        if time.monotonic() > self._last:
            item.session.shouldstop = "the budget is spent"

        def stop(*_: Any) -> None:
            self.outcomes.ran_long = True
            self.outcomes.failed = self.outcomes.failed or item.nodeid
            raise RanLong(item.nodeid)

        usual = self.compiling + (self.slowest if self.chosen is None else 5.0 + 10.0 * self.chosen[item.nodeid])
        before = signal.signal(signal.SIGALRM, stop)
        signal.setitimer(signal.ITIMER_REAL, usual)
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            self.outcomes.passed[report.nodeid] = round(report.duration, 3)
        elif report.failed:
            self.outcomes.passed.pop(report.nodeid, None)
            self.outcomes.failed = self.outcomes.failed or report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.outcomes.failed = self.outcomes.failed or f"import of {report.nodeid}"


def run_tests(
    top: Path, tests: list[Path], chosen: dict[str, float] | None, slowest: float, compiling: float, output: Path
) -> Outcomes:  # fmt: skip
    """Run tests, in a process of their own.

    Args:
        top: Folder of the checkout. tests: Files.
        chosen: Tests to run, and how long they take without a mutant, s; the run ends with the first that fails.
            None: all tests, to the last; those that take longer than `slowest`, s, count as failed.
        compiling: Time that any test may take to compile kernels, s.
        output: File for what pytest prints.
    """
    os.chdir(top)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    watch = Watch(chosen, slowest, compiling)
    with output.open("w") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
        with contextlib.suppress(SystemExit, RanLong):
            words = [
                "-q",
                "--assert=plain",
                "-p",
                "no:cacheprovider",
                "-p",
                "no:xdist",
                *(["-x"] if chosen is not None else []),
            ]
            pytest.main([*words, *map(str, tests)], plugins=[watch])
    return watch.outcomes
