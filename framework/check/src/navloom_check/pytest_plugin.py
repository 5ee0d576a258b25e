"""Checks of a plugin as tests of its distribution. Pytest loads this wherever navloom is installed.

    import pytest

    @pytest.mark.navloom_plugin("avoider.demo", params=["gain=2.0"])
    def test_it_passes(plugin_check):
        plugin_check()

This is one test for each check of `navloom check avoider.demo`. A check that does not apply is skipped, with a reason.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from navloom_check.findings import CheckReport

__all__ = ["plugin_check"]

MARK = "navloom_plugin"
FIXTURE = "plugin_check"


def pytest_configure(config: pytest.Config) -> None:
    """Register the mark."""
    config.addinivalue_line(
        "markers",
        f"{MARK}(name, params=(), seed=0, tiers=…): the plugin that `{FIXTURE}` checks, as in `navloom check`",
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Make one test for each check."""
    if FIXTURE not in metafunc.fixturenames:
        return
    mark = metafunc.definition.get_closest_marker(MARK)
    if mark is None or not mark.args:
        raise pytest.UsageError(f"{metafunc.definition.nodeid}: mark it with @pytest.mark.{MARK}('avoider.demo')")
    from navloom_check.tiers import TIERS, checks_of

    name = str(mark.args[0])
    tiers = tuple(mark.kwargs.get("tiers", TIERS))
    found = [one.name for one in checks_of(name.partition(".")[0], tiers)]
    asked = (name, tuple(mark.kwargs.get("params", ())), int(mark.kwargs.get("seed", 0)), tiers)
    metafunc.parametrize(FIXTURE, [(asked, check) for check in found], ids=found, indirect=True)


@pytest.fixture
def plugin_check(request: pytest.FixtureRequest) -> Callable[[], None]:
    """A function that fails if the check found a fault, and skips if the check does not apply."""
    asked, name = request.param

    def run() -> None:
        report = _report(*asked)
        result = next(one for one in report.results if one.check == name)
        if result.outcome == "not_run":
            pytest.skip(result.reason)
        if result.outcome == "failed":
            pytest.fail("\n".join([*report.sentences(result), report.command(result)]), pytrace=False)

    return run


@cache
def _report(name: str, params: Sequence[str], seed: int, tiers: Sequence[str]) -> CheckReport:
    """The report of one plugin, made once a session."""
    from navloom_check.runner import check_plugin

    options: dict[str, Any] = {"params": params, "seed": seed, "tiers": tiers}
    return check_plugin(name, **options)
