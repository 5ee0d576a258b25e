"""The command line of `navloom bench`; `measuring` does the work."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = ["bench"]


def bench(
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="NAME", help="loop, planner, rays, codec, bus or barn; repeats."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Small inputs: shows that it works, not how fast.")] = False,
    barn: Annotated[
        str | None, typer.Option(metavar="F.npz#N", help="A BARN world, for `barn`; without #N the file's first.")
    ] = None,
    irsim: Annotated[
        str, typer.Option(metavar="PYTHON", help="Interpreter that has ir-sim; default: this one.", show_default=False)
    ] = sys.executable,
    page_file: Annotated[
        Path | None,
        typer.Option("--page", metavar="F.md", help="Also write the figures as a page of the documentation."),
    ] = None,
    date: Annotated[
        str,
        typer.Option(
            metavar="YYYY-MM-DD", help="Date of the measurement, for --page; default: today.", show_default=False
        ),
    ] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Measure navloom and installed peers on this machine.

    Exit 1: a requested entry has no figures.
    """
    from navloom.cli.output import log_of, print_json
    from navloom.files import write_whole

    from navloom_benchmarks.measuring import bench as measure
    from navloom_benchmarks.page import page

    if page_file is not None:
        _prepare(page_file)
    found = measure(only or (), quick, barn, irsim, log_of("benchmarks").info)
    if page_file is not None:
        write_whole(page_file, page(found, date or time.strftime("%Y-%m-%d")))
    if as_json:
        print_json(found)
    else:
        _print(found)
    raise typer.Exit(1 if set(found["left_out"]) - {"barn"} or (barn and "barn" in found["left_out"]) else 0)


def _prepare(page_file: Path) -> None:
    """Create the folder of the page, and check that it can be written, before the measurement, which takes minutes.

    Raises:
        ConfigError: It cannot be written.
    """
    from navloom.config import ConfigError
    from navloom.files import make_writable

    try:
        make_writable(page_file.parent)
    except OSError as error:
        raise ConfigError(f"--page {page_file}: cannot be written: {error.strerror}; name another file") from None
    if page_file.is_dir():
        raise ConfigError(f"--page {page_file}: is a folder; name a file in it")


def _print(found: dict[str, Any]) -> None:
    from navloom.cli.output import print_table

    at = found["machine"]
    busy = "; it is busy: trust ratios, not durations" if at["load"] > 0.5 * at["cpus"] else ""
    typer.echo(f"{at['cpu']}, {at['cpus']} CPUs, Python {at['python']}, load {at['load']}{busy}")
    if found["quick"]:
        typer.echo("--quick: these figures show that it works, not how fast it is")
    columns = ("", "ours", "theirs", "unit", "times as fast", "quartiles", "compared with")
    print_table(columns, [_entries(row) for row in found["rows"]])
    notes: dict[str, list[str]] = {}
    for row in found["rows"]:
        notes.setdefault(row["note"], []).append(row["name"])
    for note, names in notes.items():
        typer.echo(f"{'; '.join(dict.fromkeys(names))}: {note}")
    for name, why in found["left_out"].items():
        typer.echo(f"left out: {name}: {why}")


def _entries(row: dict[str, Any]) -> tuple[Any, ...]:
    spread = None if row["low"] is None else f"{row['low']:.3g} to {row['high']:.3g}"
    ratio = None if row["ratio"] is None else f"{row['ratio']:.3g}"
    return row["name"], row["ours"], row["theirs"], row["unit"], ratio, spread, row["peer"]
