"""The command `navloom paper`, which reproduces the paper's figures and numbers."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from navloom_hoang2013.statements import Statement

__all__ = ["DEFAULT", "paper"]

DEFAULT = Path("navloom-paper")
WIDTH = 48
"""Longest quotation in the table on a terminal, characters; the report has them whole."""


def paper(
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help=f"Folder for the report; default: {DEFAULT}. It is never overwritten."),
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", help="Seed of the noise; default: the config's.")] = None,
    campaigns: Annotated[
        bool, typer.Option("--campaigns", help="Also drive 720 times with wrong wheels and tracks: some minutes.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON object.")] = False,
) -> None:
    """Reproduce Hoang and others (2013): figures, numbers, errata.

    Figures 6 to 12, every statement of the paper beside what our runs gave, and what each of its errata changes.

    Exit 0: with and without the obstacle O, the robot truly arrived at D through gate B without contact; else 1.
    """
    from navloom.cli import print_json
    from navloom.runs import OutFolder

    from navloom_hoang2013.measured import statements_of
    from navloom_hoang2013.reproduction import FILES, PaperError, facts_of, files_of, is_reproduced, reproduce, steps

    try:
        with OutFolder(out or DEFAULT, FILES) as folder:
            with _progress(as_json, steps(campaigns)) as say:
                made = reproduce(seed, say, campaigns=campaigns)
                files = files_of(made, say)
            folder.write(files)
    except PaperError as error:
        typer.echo(f"navloom: {error}", err=True)
        raise typer.Exit(1) from None
    if as_json:
        print_json({"out": str(folder.folder), "files": sorted(folder.names), **facts_of(made)})
    else:
        _print(statements_of(made))
        if not folder.failure:
            typer.echo(f"written to {folder.folder}: report.html, and each figure as PNG and SVG")
    if folder.failure:
        typer.echo(f"navloom: {folder.failure}", err=True)
    raise typer.Exit(0 if is_reproduced(made) and not folder.failure else 1)


def _print(statements: Sequence[Statement]) -> None:
    """Print the table for people, and how many statements got which verdict."""
    from navloom.cli import print_table

    rows = [
        (row.id, row.printed if len(row.printed) <= WIDTH else row.printed[: WIDTH - 1] + "…", row.ours, row.verdict)
        for row in statements
    ]
    print_table(("", "printed", "ours", "verdict"), rows)
    tally = Counter(row.verdict for row in statements)
    counts = ", ".join(f"{number} {verdict}" for verdict, number in tally.most_common())
    typer.echo(f"{len(statements)} statements: {counts}")


@contextmanager
def _progress(quiet: bool, total: int) -> Iterator[Callable[[str], None]]:
    """Progress on standard error: a bar on a terminal, else one line."""
    if quiet:
        yield lambda text: None
    elif not sys.stderr.isatty():
        print("navloom: reproducing the paper; the first run compiles kernels, later ones load them", file=sys.stderr)
        yield lambda text: None
    else:
        from navloom.cli import progress_line

        with progress_line("reproducing the paper (compiles in the first run)", total) as update:
            yield lambda text: update(description=text, advance=1)
