"""Output of `navloom replay` for a plugin that was run on recorded inputs."""

from __future__ import annotations

from typing import Any

import typer
from navloom.cli.output import LOG

__all__ = ["can_draw", "tell_substitute"]


def can_draw() -> bool:
    """Whether navloom-study is installed; if not, logs what to install, and that the rest is complete."""
    from navloom.parts import MissingPartError, part

    try:
        part("navloom_study", "a picture")
    except MissingPartError as error:
        LOG.warning(f"no picture is drawn, the rest is kept: {error}")
        return False
    return True


def tell_substitute(found: Any, recorded: str) -> None:
    """Print one comparison for people."""
    from navloom.cli.output import print_table
    from navloom.engine.difference_units import UNITS

    summary = found.found.summary()
    share = summary.differing_share
    typer.echo(f"{summary.role} {summary.instance} on what {recorded} was given, {summary.ticks} ticks compared")
    if share is None:
        typer.echo("no tick in which both gave an answer")
    else:
        differing = sum(found.found.differing)
        first = summary.first_differing_tick
        typer.echo(
            f"differs in {differing} ticks ({share:.1%})"
            + ("" if first is None else f", first in tick {first} ({summary.first_differing_s:.2f} s)")
        )
        typer.echo(f"ticks that differ: {_spans(found.found) or 'none'}")
        rows = [(name, UNITS[name], sizes.rms, sizes.max) for name, sizes in summary.differences.items()]
        print_table(("difference", "unit", "rms", "max"), rows)
    if summary.unanswered:
        typer.echo(f"only one of the two gave an answer in {summary.unanswered} ticks")
    for text in (*found.faults[:1], *found.not_fed[:1], *found.notes):
        if text:
            typer.echo(f"note: {text}")


def _spans(found: Any) -> str:
    """Ticks that differ, as first-last of each run of consecutive compared ticks."""
    spans: list[list[int]] = []
    previous = False
    for tick, differs in zip(found.ticks, found.differing, strict=True):
        if differs and previous:
            spans[-1][1] = tick
        elif differs:
            spans.append([tick, tick])
        previous = differs
    return ", ".join(f"{first}-{last}" if last > first else str(first) for first, last in spans)
