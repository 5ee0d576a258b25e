"""`navloom compare --suite`: methods in a named set of worlds, conditions and seeds, beside the stored results."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from navloom.cli.output import LOG

if TYPE_CHECKING:
    from navloom_study.suites.result_file import SuiteResult

__all__ = ["RESULTS", "SuiteOptions", "compare_in_suite", "result_line"]

RESULTS = Path("docs") / "results"
"""Folder of the stored results, in a copy of the project."""
SECTION = "Suite"

ResultsFolder = Annotated[
    Path,
    typer.Option(
        "--results", metavar="DIR", help="Folder of stored results, beside those of navloom.", rich_help_panel=SECTION
    ),
]


@dataclass(frozen=True)
class SuiteOptions:
    """Options of a study in a suite, in place of CONFIG, --vary, --worlds, --seeds, --set and --primary."""

    suite: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Run in this suite, an installed one or a .toml file, instead of CONFIG.",
            rich_help_panel=SECTION,
        ),
    ] = ""  # fmt: skip
    method: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE", help="Methods of a file with tables [[method]]; repeats.", rich_help_panel=SECTION
        ),
    ] = None
    methods: Annotated[
        str, typer.Option(metavar="NAME,…", help="Methods of the suite itself to drive too.", rich_help_panel=SECTION)
    ] = ""
    results: ResultsFolder = RESULTS

    def refuse_beside(self, given: Mapping[str, Any]) -> None:
        """Refuse options that would change the suite, or that mean nothing in it. Raises ConfigError."""
        from navloom.config import ConfigError

        if not self.suite:
            raise ConfigError("--method and --methods: say in which suite, as in --suite doors-1")
        if wrong := [option for option, value in given.items() if value]:
            raise ConfigError(f"--suite {self.suite} with {', '.join(wrong)}: the suite decides that; leave it out")


def compare_in_suite(
    asked: SuiteOptions,
    out: Path | None,
    jobs: int | None,
    hang_after: float,
    as_json: bool,
    progress: Callable[[bool], AbstractContextManager[Callable[[int, int, float | None], None]]],
) -> None:
    """Run methods in a suite, write the result, and print their rows beside the stored ones."""
    from navloom.cli.output import print_json
    from navloom.files import write_each
    from navloom.plugins import Discovery
    from navloom.plugins.one_file import files_in_use

    from navloom_study.suites.method_files import read_methods
    from navloom_study.suites.results_store import known_results
    from navloom_study.suites.suite import suite_named
    from navloom_study.suites.suite_run import plan_suite, run_suite

    suite = suite_named(asked.suite, Discovery())
    given = {name: table for file in asked.method or () for name, table in read_methods(file).items()}
    stored = [found for found in known_results(asked.results) if found.suite == suite.name]
    own = [name.strip() for name in asked.methods.split(",") if name.strip()]
    if not own and (not stored or not given):
        own = [suite.baseline]
    plan = plan_suite(suite, own, given)
    with progress(as_json) as tell:
        result, cost = run_suite(plan, out, jobs=jobs, progress=tell, hang_after=hang_after)
    files = []
    if out is not None:
        texts: dict[str, str | bytes] = {"result.json": result.text(), "cost.json": json.dumps(cost, indent=1) + "\n"}
        files = [*texts]
        for name, why in write_each(out, texts).items():
            LOG.warning(f"--out {out}: {name}: {why}")
            raise typer.Exit(1)
    if as_json:
        print_json({"suite": suite.name, "summary": result.summary, "cost": cost, "files": files})
        return
    _print(result, cost, [found for found in stored if not {*found.methods} & {*result.methods}], asked.results)
    if out is None:
        typer.echo("not saved: with --out DIR, compare writes result.json, and the same command continues the suite")
    else:
        add = ["navloom", "results", "add", str(out / "result.json")]
        add += [word for file in files_in_use() for word in ("--plugin", file)]
        add += ["--suite", asked.suite] if asked.suite.endswith(".toml") else []
        add += ["--results", str(asked.results)] if asked.results != RESULTS else []
        typer.echo(f"written to {out}: {', '.join(files)}; `{shlex.join(add)}` checks and stores it")


def _print(result: SuiteResult, cost: Mapping[str, Any], stored: list[SuiteResult], results: Path) -> None:
    from navloom.cli.output import print_table

    from navloom_study.suites.results_store import stored_cost

    def told(name: str) -> str:
        step = stored_cost(results, result.suite, name).get("step_us")
        return "stored" if step is None else f"{step / 1000:.2f} stored"

    lines = [(name, *result_line(result, name), f"{cost[name]['step_us'] / 1000:.2f}") for name in result.methods
             if name in cost]  # fmt: skip
    lines += [(name, *result_line(found, name), told(name)) for found in stored for name in found.methods]
    typer.echo(f"{result.suite}: {result.primary}, mean over worlds with its 95 % interval")
    print_table(("method", result.primary, "episodes", "reached", "contacts", "step, ms"), lines)


def result_line(result: SuiteResult, method: str) -> tuple[str, int, int, int]:
    """Primary metric with its interval; numbers of episodes, of those that arrived, and of those with contact."""
    told = result.summary[method]
    parts = told["parts"].values()
    return (
        interval_text(told["metrics"][result.primary]),
        told["episodes"],
        sum(part["reached"] for part in parts),
        sum(part["contacts"] for part in parts),
    )


def interval_text(ends: Any) -> str:
    """A mean with its interval, as `0.493 [0.482, 0.498]`."""
    mean, low, high = ends
    if mean is None:
        return "not defined"
    return f"{mean:.3f}" if low is None else f"{mean:.3f} [{low:.3f}, {high:.3f}]"
