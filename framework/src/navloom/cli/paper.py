"""`navloom paper`: the paper's figures and numbers again."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from navloom.study.paper_numbers import Number

__all__ = ["DEFAULT", "paper"]

DEFAULT = Path("navloom-paper")


def paper(
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help=f"Folder for the report; default: {DEFAULT}, which must not exist yet."),
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", help="Seed of the noise; default: the config's.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON object.")] = False,
) -> None:
    """Reproduce Hoang et al. 2013: Figures 6 to 11, every number beside the paper's, and what its errata change.

    Exit 0: the robot arrived at D both times, through gate B and without contact; 1: it did not.
    """
    from navloom.cli.output import print_json
    from navloom.study.paper import PaperError, facts_of, files_of, is_reproduced, keep, reproduce, steps
    from navloom.study.plotting import need_matplotlib

    folder = _folder(out)
    need_matplotlib()
    try:
        with _progress(as_json, steps()) as say:
            made = reproduce(seed, say)
            files = files_of(made, say)
    except PaperError as error:
        typer.echo(f"navloom: {error}", err=True)
        raise typer.Exit(1) from None
    keep(files, folder)
    if as_json:
        print_json({"out": str(folder), "files": sorted(files), **facts_of(made)})
    else:
        _print(made.numbers)
        typer.echo(f"kept in {folder}: report.html, and each figure as PNG and SVG")
    raise typer.Exit(0 if is_reproduced(made) else 1)


def _folder(out: Path | None) -> Path:
    """Where to write to. Raises ConfigError before anything runs where that cannot be."""
    from navloom.config import ConfigError

    if out is None:
        if DEFAULT.exists():
            raise ConfigError(f"{DEFAULT}: exists already; name another folder, or this one, with --out DIR")
        return DEFAULT
    if out.exists() and not out.is_dir():
        raise ConfigError(f"--out {out}: is a file; name a folder")
    return out


def _print(numbers: Sequence[Number]) -> None:
    """The table for people."""
    from navloom.cli.output import print_table

    rows = [(number.what, number.paper, number.ours, number.section) for number in numbers]
    print_table(("value", "paper", "ours", "section"), rows)


@contextmanager
def _progress(quiet: bool, total: int) -> Iterator[Callable[[str], None]]:
    """Progress on standard error: a bar on a terminal, else one line."""
    if quiet:
        yield lambda text: None
    elif not sys.stderr.isatty():
        print("navloom: reproducing the paper; the first run compiles kernels, later ones load them", file=sys.stderr)
        yield lambda text: None
    else:
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("reproducing the paper (the first run compiles kernels)", total=total)

            def say(text: str) -> None:
                bar.update(task, description=text, advance=1)

            yield say
