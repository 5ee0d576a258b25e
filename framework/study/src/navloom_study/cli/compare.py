"""`navloom compare`: a closed-loop study of methods over worlds and seeds."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from navloom.cli.command import SectionedCommand, made_with
from navloom.cli.interrupts import ending, terminate_as_interrupted
from navloom.cli.options import ConfigName, PluginFiles, ViewOptions, a_number
from navloom.cli.output import LOG, log_of
from navloom.parts import part

from navloom_study.cli.suite import SuiteOptions, compare_in_suite

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from navloom.runs.episode import Episode

    from navloom_study.compare import Study, StudyResult

__all__ = ["Variadic", "compare"]

MANY = ("--worlds", "--vary", "--set")


class Variadic(SectionedCommand):
    """Lets an option take several values in a row: `--worlds doorway u_trap`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Repeat the option before each further value."""
        given: list[str] = []
        option, taken = "", 0
        # Typer knows no options with several values in a row.
        for word in args:
            if word.startswith("-"):
                option, taken = word if word in MANY else "", 0
            elif option:
                given += [option] if taken else []
                taken += 1
            given.append(word)
        return super().parse_args(ctx, given)


"""Settings of the command: its options may take several values in a row."""


@made_with(cls=Variadic)
def compare(
    config: ConfigName = "",
    *,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH=A,B", help="A role's plugins or alternatives, a setting's values, or method=A,B; repeats."
        ),
    ] = None,
    worlds: Annotated[
        list[str] | None,
        typer.Option(metavar="REF…", help="Worlds, also clutter:0-49 and barn:F.npz#1-50; default: the config's own."),
    ] = None,
    seeds: Annotated[str, typer.Option(metavar="0:10", help="0 to 9, or a list; default: the config's own.")] = "",
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="A.B=V", help="Change one value for all methods; repeats.")
    ] = None,
    plugin: PluginFiles = None,
    jobs: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Worker processes; default: one per core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDR", help="Run on a Dask cluster, as tcp://10.0.0.5:8786.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the study; an interrupted study continues.")
    ] = None,
    baseline: Annotated[
        str, typer.Option(metavar="METHOD", help="Compare the others with this method; default: the first.")
    ] = "",
    primary: Annotated[
        str,
        typer.Option(
            metavar="METRIC,…", help="Metrics the study asks about; default: success, else spl. Others are exploratory."
        ),
    ] = "",
    open_loop: Annotated[
        bool,
        typer.Option("--open-loop", help="Also drive the baseline with the others in shadow, once per world and seed."),
    ] = False,
    twice: Annotated[
        bool,
        typer.Option(
            "--twice", help="Also run the first episode of each method twice; exit 1 if the second run differs."
        ),
    ] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Drive each episode live, in its processes, one after the other.")
    ] = False,
    hang_after: Annotated[
        float,
        typer.Option(
            metavar="S", min=1.0, help="Kill a worker that gives no sign of life for this long.", callback=a_number
        ),
    ] = 300.0,
    view: ViewOptions,
    suite: SuiteOptions,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON object.")] = False,
) -> None:
    """Run methods over worlds and seeds in closed loop. The same command continues an interrupted study.

    With --view, --web, --viewer or --rerun there is no study: the methods drive side by side in the viewer, in the
    first world with the first seed. Exit 0: every episode ended, whatever its outcome; 1: interrupted, or
    --twice found a difference; 2: the request was wrong.
    """
    from navloom.cli.output import print_json
    from navloom.config import ConfigError
    from navloom.runs.result_folder import failure_of

    from navloom_study.compare import plan_study, run_study
    from navloom_study.study_worlds import seeds_of

    terminate_as_interrupted()
    if suite.suite or suite.method or suite.methods:
        suite.refuse_beside({
            f"CONFIG {config}": config, "--vary": vary, "--worlds": worlds, "--seeds": seeds, "--set": set_,
            "--primary": primary, "--scheduler": scheduler, "--baseline": baseline, "--open-loop": open_loop,
            "--twice": twice, "--live": live, "a viewer": view.asked(),
        })  # fmt: skip
        with _kept(out):
            compare_in_suite(suite, out, jobs, hang_after, as_json, _progress)
        return
    if not config:
        raise ConfigError("CONFIG: is missing: name a config, as in `navloom compare paper`, or give --suite NAME")
    if live:
        _refuse_beside_live(jobs, scheduler, open_loop, twice, view)
    seeds_asked = seeds_of(seeds) if seeds else ()
    study = plan_study(
        config, vary or (), worlds or (), seeds_asked, set_ or (), baseline=baseline, open_loop=open_loop,
        is_live=live, primary=[name.strip() for name in primary.split(",") if name.strip()],
    )  # fmt: skip
    for method, places in study.dropped.items():
        if places:
            belong = "belongs" if len(places) == 1 else "belong"
            LOG.info(f"{method}: {', '.join(places)} {belong} to the replaced plugin: dropped")
    for reason in study.unusable:
        LOG.warning(f"{reason}; the study goes on without this metric")
    if (where := view.asked()) is not None:
        if study.is_fleet:
            raise ConfigError(
                f"{config}: a fleet is shown by `navloom run`, one method at a time: leave the viewer out"
            )
        _show(study, where, as_json)
        return
    with _kept(out), _executor(scheduler) as executor, _progress(as_json) as progress, _stopping(live) as ends:
        result = run_study(
            study, out, jobs=jobs, executor=executor, progress=progress, hang_after=hang_after, twice=twice,
            ending=ends, say=LOG.info,
        )  # fmt: skip
    for note in result.notes:
        LOG.info(note)
    for warning in result.warnings:
        LOG.warning(_in_words(warning))
    if out is not None:
        result = _reported(result, out)
    if as_json:
        print_json(_as_json(result, out))
    else:
        _print(result, out)
    if result.missing:
        failure = failure_of(f"--out {out}", result.files, result.missing)
        LOG.warning(f"{failure}; make room, and the same command writes the rest")
    if result.missing or not result.is_repeatable:
        raise typer.Exit(1)


@contextmanager
def _kept(out: Path | None) -> Iterator[None]:
    """Exit 1 where the episodes cannot go on or are interrupted: those that have ended are kept."""
    from navloom_study.study_folder import StudyError
    from navloom_study.worker_pool import PoolError

    try:
        yield
    except (PoolError, StudyError) as error:
        LOG.warning(str(error))
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        kept = f"; the same command goes on from {out}" if out is not None else ""
        LOG.warning(f"interrupted{kept}")
        raise typer.Exit(1) from None


def _refuse_beside_live(
    jobs: int | None, scheduler: str | None, open_loop: bool, twice: bool, view: ViewOptions
) -> None:
    """Refuse options that make no sense for live episodes. Raises ConfigError."""
    from navloom.config import ConfigError

    reasons = {
        f"--jobs {jobs}": (jobs or 1) > 1 and "live episodes run one after the other, or they would slow each other",
        "--scheduler": scheduler is not None and "live episodes run on this host",
        "--open-loop": open_loop and "it drives in lockstep; `navloom up --shadow` compares answers live",
        "--twice": twice and "two live drives are never equal",
        "a viewer": view.asked() is not None and "`navloom view` shows a live robot",
    }
    for option, reason in reasons.items():
        if reason:
            raise ConfigError(f"--live with {option}: {reason}; leave one of them out")


@contextmanager
def _stopping(live: bool) -> Iterator[threading.Event | None]:
    """For a live study, an event that Ctrl-C sets, so that the robot's processes end in order."""
    if not live:
        yield None
        return
    with ending() as event:
        yield event


def _in_words(warning: Mapping[str, Any]) -> str:
    """A warning of a study, with the method and the episodes that it concerns."""
    count, world, seed = warning["episodes"], warning["world"], warning["seed"]
    episodes = "1 episode" if count == 1 else f"{count} episodes, the first"
    return f"warning: {warning['method']}: {warning['text']} ({episodes}: {world}, seed {seed})"


def _show(study: Study, where: Any, as_json: bool) -> None:
    """Drive one episode of each method in one picture, and print the outcomes."""
    from navloom.cli.output import print_json, print_table

    from navloom_study.study_worlds import placed

    world, seed = study.worlds[0], study.seeds[0]
    methods = {m.name: placed(m.loaded.to_json(), world.values, seed, study.here) for m in study.methods}
    title = f"{study.config}: {world.ref}, seed {seed}"

    def tell(episodes: Mapping[str, Episode]) -> None:
        found = {name: episode.summary() for name, episode in episodes.items()}
        if as_json:
            print_json({"world": world.ref, "seed": seed, "methods": found})
            return
        typer.echo(title)
        keys = ("sim_time_s", "path_length_m", "min_clearance_m")
        ends = {name: episode.trail for name, episode in episodes.items()}
        lines = [
            (name, ends[name].outcome, *(one[key] for key in keys), ends[name].reason) for name, one in found.items()
        ]
        print_table(("method", "outcome", "time, s", "driven, m", "minimum clearance, m", "reason"), lines)

    counts = part("navloom_viewer.side_by_side").drive_side_by_side(methods, where, title, log_of("viewer").info, tell)
    if where.file is not None and counts.file_failure:
        raise typer.Exit(1)


def _reported(result: StudyResult, out: Path) -> StudyResult:
    """Write the report beside the tables, and add its files to the result."""
    from dataclasses import replace

    from navloom_study.report.study_report import FILES, write_report

    if result.missing:  # the report is made from these tables
        return result
    made = write_report(out, result.study.baseline)
    names = [name for name in FILES if name not in made.missing]
    return replace(result, files=(*result.files, *names), missing=made.missing)


def _as_json(result: StudyResult, out: Path | None) -> dict[str, Any]:
    study = result.study
    rows = [
        {
            **vars(r.key),
            "outcome": r.outcome,
            "reason": r.reason,
            **r.metrics,
            "trace_sha256": r.trace_sha256,
            **({"members": {one.name: vars(one) for one in r.members}} if r.members else {}),
        }
        for r in result.rows
    ]
    return {
        **study.request(),
        "out": None if out is None else str(out),
        "went_on_from": result.before,
        "workers_lost": result.lost,
        "wall_s": result.wall,
        "summary": result.summary(),
        **({"member_summary": result.members()} if study.is_fleet else {}),
        "verdict": result.verdicts,
        "untested_worlds": result.untested,
        "notes": result.notes,
        "warnings": result.warnings,
        "episodes": rows,
    }


def _print(result: StudyResult, out: Path | None) -> None:
    """Print a study's result for people."""
    from navloom.cli.output import print_table
    from navloom.runs.metrics import headlines

    study = result.study
    shown = study.metrics if study.is_fleet else headlines(study.metrics)
    lines = []
    for name, found in result.summary().items():
        means = (_mean(found, metric) for metric in shown)
        lines.append((name, found["episodes"], *means, _counted(found["outcomes"])))
    worlds, seeds = len(study.worlds), len(study.seeds)
    driven = "live episodes" if study.is_live else "fleets" if study.is_fleet else "episodes"
    typer.echo(
        f"{len(study.methods)} methods x {worlds} worlds x {seeds} seeds: {len(result.rows)} {driven}, "
        f"{result.before} of them from an earlier run, in {result.wall:.1f} s; means over episodes"
    )
    print_table(("method", driven, *shown, "outcomes"), lines)
    if study.is_fleet:
        _print_members(result)
    for line in (*result.verdicts, *_truths(result)):
        typer.echo(line)
    if out is None:
        typer.echo("not saved: with --out DIR, compare writes the table, and the same command continues the study")
    else:
        typer.echo(f"written to {out}: {', '.join(result.files)}")


def _print_members(result: StudyResult) -> None:
    """Print a row for each member: means without intervals, since those of one fleet depend on each other."""
    from navloom.cli.output import print_table

    from navloom_study.fleet_episodes import OF_MEMBERS

    lines = [
        (method, name, *(found["means"][metric] for metric in OF_MEMBERS), _counted(found["outcomes"]))
        for method, members in result.members().items()
        for name, found in members.items()
    ]
    typer.echo("members; means over the fleets:")
    print_table(("method", "member", *OF_MEMBERS, "outcomes"), lines)


def _counted(outcomes: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())


def _mean(found: Mapping[str, Any], metric: str) -> Any:
    """A mean, with the 95 % interval if it is a share."""
    mean, ends = found["means"][metric], found["intervals"].get(metric)
    return mean if ends is None or mean is None else f"{mean:.3g} [{ends[0]:.2g}, {ends[1]:.2g}]"


def _truths(result: StudyResult) -> Iterator[str]:
    """For each method, successes that the ground truth refutes, and those without a ground truth."""
    from navloom.runs.episode_trail import FALSE_SUCCESS, STRUCK

    for method in result.study.methods:
        rows = [row for row in result.rows if row.key.method == method.name]
        false = sum(row.outcome == FALSE_SUCCESS for row in rows)
        untold = sum(row.outcome == "succeeded" and row.metrics.get("false_success") is None for row in rows)
        if false:
            yield (
                f"{method.name}: false success in {false} of {len(rows)} episodes: the robot said that it had arrived, "
                "and the ground truth says that it had not; counted as failures"
            )
        if struck := sum(row.outcome == STRUCK for row in rows):
            yield (
                f"{method.name}: struck in {struck} of {len(rows)} episodes: something ran into the robot, and would "
                "have run into one that stands; counted as failures"
            )
        if untold:
            yield f"{method.name}: {untold} of {len(rows)} successes are the robot's own report, without ground truth"


@contextmanager
def _executor(address: str | None) -> Iterator[Executor | None]:
    """The executor of a Dask cluster; None without an address."""
    if address is None:
        yield None
        return
    from navloom.config import ConfigError

    try:
        distributed = import_module("distributed")
    except ImportError:
        raise ConfigError("--scheduler: needs the extra `cluster`, as in pip install 'navloom[cluster]'") from None
    try:
        client = distributed.Client(address, timeout=10.0)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--scheduler {address}: no Dask scheduler answers there: {error}") from None
    with client:
        yield client.get_executor()


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[int, int, float | None], None]]:
    """Progress on standard error: a bar on a terminal, otherwise lines at intervals."""
    if quiet:
        yield lambda done, total, left: None
    elif sys.stderr.isatty():
        from navloom.cli.output import progress_line

        with progress_line("starting") as update:
            yield lambda done, total, left: update(description=_far(done, total, left), completed=done, total=total)
    else:
        from navloom.cli.output import paced

        say = paced()
        yield lambda done, total, left: say(_far(done, total, left))


def _far(done: int, total: int, left: float | None) -> str:
    """Progress of a study in words."""
    if left is None:
        return f"{done} of {total} episodes (the first run compiles kernels, later ones load them)"
    minutes, seconds = divmod(round(left), 60)
    return (
        f"{done} of {total} episodes, {minutes} min {seconds} s left"
        if minutes
        else (f"{done} of {total} episodes, {seconds} s left")
    )
