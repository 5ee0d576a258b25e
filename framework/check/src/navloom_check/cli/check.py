"""`navloom check`: checks that a plugin keeps the framework's contract."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from navloom.cli.interrupts import terminate_as_interrupted
from navloom.cli.options import AsJson, PluginFiles
from navloom.parts import part

if TYPE_CHECKING:
    from navloom_check.findings import CheckReport

__all__ = ["check"]

COUNTED = (
    ("passed", "checks passed"),
    ("failed", "failed"),
    ("shown", "measured but not claimed"),
    ("not_run", "not run"),
)
"""Outcomes of checks in the last line of a report, in its order."""


def check(
    name: Annotated[
        str | None, typer.Argument(metavar="ROLE.NAME", help="Like avoider.vff, metric.…, world.door:2.0.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=V", help="A parameter of the plugin; repeats.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="CHECK", help="Run only this check; repeats.")
    ] = None,
    tier: Annotated[list[str] | None, typer.Option(metavar="TIER", help="Run only this tier; repeats.")] = None,
    plugin: PluginFiles = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers in the checks.")] = 0,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write pictures into this folder.")] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="List the checks, or those of ROLE.NAME, and run none.")
    ] = False,
    hardware: Annotated[
        str | None,
        typer.Option(metavar="CONFIG", help="Check the real platform of this config with its hardware; nothing moves."),
    ] = None,
    drive: Annotated[
        bool, typer.Option("--drive", help="With --hardware: drive a short distance, turn and stop.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check one plugin in a separate process.

    Exit 0: no check failed; 1: a check failed.
    """
    from navloom.cli.output import paced, progress_line, say_so
    from navloom.config import ConfigError

    from navloom_check.runner import check_plugin
    from navloom_check.tiers import TIERS

    _refuse_unknown(name, only or (), tier or ())
    if list_:
        _list(name, tier or tuple(TIERS), as_json)
        return
    if name is None:
        raise ConfigError("ROLE.NAME is missing, as in navloom check avoider.vff; --list lists the checks")
    _refuse_missing(name)
    terminate_as_interrupted()
    if drive and hardware is None:
        raise ConfigError("--drive: moves real hardware, so it needs --hardware CONFIG")
    if hardware is not None:
        from navloom_check.hardware_check import check_hardware

        _end(check_hardware(hardware, name, set_ or (), drive, say_so), as_json)
        return
    if out is not None:
        part("navloom_study", "--out")
        out.mkdir(parents=True, exist_ok=True)
    with progress_line(f"checking {name}") as update:
        say = paced()

        def progress(one: str, done: int, total: int) -> None:
            update(description=one, completed=done, total=total)
            # A terminal shows the progress line itself; a log needs whole lines, and few of them.
            if not sys.stderr.isatty():
                say(f"checking {name}: {done} of {total} checks done, now {one}")

        report = check_plugin(
            name,
            params=set_ or (),
            seed=seed,
            tiers=tier or tuple(TIERS),
            only=only or (),
            out=out,
            progress=progress,
        )
    _end(report, as_json, "" if out is not None else "; --out DIR draws the scenes")


def _end(report: CheckReport, as_json: bool, hint: str = "") -> None:
    """Print a report; exit with code 1 if a check failed, with the hint if it is one of behaviour."""
    from navloom.cli.output import print_json, say_so

    from navloom_check.tiers import BEHAVIOUR

    if as_json:
        print_json(report.to_json())
    else:
        _print(report)
    if report.failed:
        drawn = hint if any(result.tier == BEHAVIOUR for result in report.failed) else ""
        say_so(f"{report.plugin} fails {len(report.failed)} of {len(report.results)} checks{drawn}")
        raise typer.Exit(1)


def _print(report: CheckReport) -> None:
    """A line for each check; for failed ones also the finding, what was expected, and how to repeat it."""
    marks = {"passed": "ok", "failed": "FAILED", "not_run": "not run", "shown": "shown"}
    wide = max((len(result.check) for result in report.results), default=0)
    for result in report.results:
        typer.echo(f"{marks[result.outcome]:8}{result.check:{wide}}  {result.reason}".rstrip())
        for line in report.sentences(result):
            typer.echo(f"        {line}")
        for shown in result.shown:
            typer.echo(f"        {shown.text}{f' ({shown.picture})' if shown.picture else ''}")
        for picture in dict.fromkeys(finding.picture for finding in result.findings if finding.picture):
            typer.echo(f"        picture: {picture}")
        if result.findings:
            typer.echo(f"        repeat:  {report.command(result)}")
    counts = Counter[str](result.outcome for result in report.results)
    said = [f"{counts[one]} {words}" for one, words in COUNTED if counts[one] or one == "failed"]
    owner = f" ({report.owner})" if report.owner else ""
    typer.echo(f"{report.plugin}{owner}: {', '.join(said)}")


def _list(name: str | None, tiers: tuple[str, ...] | list[str], as_json: bool) -> None:
    from navloom.cli.output import print_json, print_table

    from navloom_check.tiers import TIERS, checks_of

    checks = (
        [one for tier in tiers for one in TIERS[tier]] if name is None else checks_of(name.partition(".")[0], tiers)
    )
    if as_json:
        print_json([
            {"name": one.name, "tier": one.tier, "kinds": sorted(one.kinds), "demands": one.demands} for one in checks
        ])  # fmt: skip
    else:
        print_table(("check", "tier", "demands"), [(one.name, one.tier, one.demands) for one in checks])


def _refuse_unknown(name: str | None, only: list[str] | tuple[str, ...], tiers: list[str] | tuple[str, ...]) -> None:
    from navloom.config import ConfigError
    from navloom.plugins.registry import nearest

    from navloom_check.tiers import TIERS

    for tier in tiers:
        if tier not in TIERS:
            raise ConfigError(f"--tier {tier}: is no tier{nearest(tier, list(TIERS))}")
    kind = None if name is None else name.partition(".")[0]
    known = [one.name for checks in TIERS.values() for one in checks if kind is None or kind in one.kinds]
    for one in only:
        if one not in known:
            raise ConfigError(
                f"--only {one}: is no check{'' if kind is None else f' of a {kind}'}{nearest(one, known)}"
            )


def _refuse_missing(name: str) -> None:
    """Refuse a name that is not installed: that is not a fault of a plugin."""
    from navloom.plugins import PluginError
    from navloom.plugins.registry import nearest
    from navloom.roles.presets import named_plugin

    from navloom_check.checked_plugin import CHECKED, CheckRequest, discovery_of, schema_of

    kind, _, plugin = named_plugin(name)[0].partition(".")
    scheme, colon, _ = plugin.partition(":")
    if kind == "scheme" and colon:
        raise PluginError(f"{name}: expected scheme.{scheme}, or world.{plugin} for the world that it reads")
    # `world.door:2.0` is made by a scheme, and that is the plugin to check.
    if kind == "world" and colon:
        kind, plugin = "scheme", scheme
    if kind not in CHECKED or not plugin:
        if kind in CHECKED:
            hint = nearest(plugin, discovery_of(CheckRequest(name)).names(kind))
        else:
            hint = discovery_of(CheckRequest(name)).meant(name) or nearest(kind, list(CHECKED))
        raise PluginError(f"{name}: expected KIND.NAME, as avoider.vff{hint}")
    known = discovery_of(CheckRequest(name)).names(kind)
    if kind == "message":
        plugin = schema_of(discovery_of(CheckRequest(name)), plugin)
    if plugin not in known:
        raise PluginError(f"no plugin {name} is installed{discovery_of(CheckRequest(name)).instead_of(kind, plugin)}")
