"""`navloom results`: lists the stored results of suites, checks and stores new ones, and makes their page."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Annotated

import typer
from navloom.cli.options import PluginFiles
from navloom.cli.output import LOG

from navloom_study.cli.suite import RESULTS, ResultsFolder, result_line

__all__ = ["app"]

PAGE = RESULTS.with_suffix(".md")

app = typer.Typer(no_args_is_help=False)


@app.callback(invoke_without_command=True)
def results(
    ctx: typer.Context,
    folder: ResultsFolder = RESULTS,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summaries as one JSON object.")] = False,
) -> None:
    """List the results of suites, stored and shipped."""
    from navloom.cli.output import print_json, print_table

    from navloom_study.suites.results_store import known_results

    if ctx.invoked_subcommand is not None:
        return
    found = known_results(folder)
    if as_json:
        print_json([{"suite": one.suite, "summary": one.summary, "checked": one.checked} for one in found])
        return
    if not found:
        typer.echo(f"{folder}: no results; `navloom compare --suite NAME --out DIR` makes one, `results add` stores it")
        return
    lines = [
        (one.suite, method, one.primary, *result_line(one, method), one.checked.get("sample", 0))
        for one in found
        for method in one.methods
    ]
    print_table(("suite", "method", "metric", "mean", "episodes", "reached", "contacts", "checked"), lines)


@app.command()
def add(
    file: Annotated[Path, typer.Argument(metavar="F", help="The result.json of `navloom compare --suite --out`.")],
    folder: ResultsFolder = RESULTS,
    sample: Annotated[int, typer.Option(metavar="N", min=1, help="Number of episodes to run again.")] = 20,
    draw: Annotated[
        int | None, typer.Option(metavar="SEED", help="Seed of the draw; default: of the system, known to nobody.")
    ] = None,
    suite: Annotated[str, typer.Option(metavar="FILE.toml", help="File of a suite that is not installed.")] = "",
    jobs: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Worker processes; default: one per core.")
    ] = None,
    plugin: PluginFiles = None,
) -> None:
    """Check a result and store it: recompute its summary, and run a sample of its episodes again.

    Exit 2: the result is refused, and nothing is stored.
    """
    from navloom.plugins import Discovery

    from navloom_study.suites.drives import pictures_of
    from navloom_study.suites.result_file import read_result
    from navloom_study.suites.results_store import cost_beside, store
    from navloom_study.suites.suite import suite_named
    from navloom_study.suites.suite_run import plan_suite
    from navloom_study.suites.verification import (
        check_request,
        check_rows,
        check_sample,
        detection,
        drawn,
        is_same_machine,
        rerun,
        stamped,
    )
    from navloom_study.worker_pool import cores

    result = read_result(file)
    check_rows(result)
    given = {name: table["set"] for name, table in result.methods.items() if table.get("set") is not None}
    own = [name for name in result.methods if name not in given]
    plan = plan_suite(suite_named(suite or result.suite, Discovery()), own, given)
    check_request(result, plan)
    keys = drawn(result.rows, sample, random.SystemRandom() if draw is None else random.Random(draw))
    count = len(keys)
    LOG.info(
        f"running {count} of {len(result.rows)} episodes again: a share of 5, 10 or 20 % of forged rows is found with "
        f"probability {detection(0.05, count):.2f}, {detection(0.1, count):.2f} or {detection(0.2, count):.2f}"
    )
    is_same = is_same_machine(result, plan)
    verified = check_sample(result, keys, rerun(plan, result.metrics, jobs or cores()), is_same)
    pictures = pictures_of(file.parent, plan, result)
    files = store(folder, stamped(result, verified), cost_beside(file), pictures)
    how = "bit for bit" if is_same else "within the interval, on another processor or with other versions"
    stored = f"{len(files)} file{'s' * (len(files) != 1)}"
    typer.echo(f"{result.suite}: {count} episodes are as they were, {how}; stored {stored} in {folder}")


@app.command()
def page(
    out: Annotated[Path, typer.Option(metavar="FILE", help="The page, Markdown with tables in HTML.")] = PAGE,
    folder: ResultsFolder = RESULTS,
) -> None:
    """Make the page of all stored results."""
    from navloom.files import write_whole

    from navloom_study.suites.results_page import results_page

    write_whole(out, results_page(folder, out.parent))
    typer.echo(f"written: {out}")
