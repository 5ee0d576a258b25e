"""`navloom report`: writes the report of a study again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from navloom.cli.options import PluginFiles
from navloom.cli.output import LOG

__all__ = ["report"]


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished study: the --out of compare.")],
    baseline: Annotated[
        str, typer.Option(metavar="METHOD", help="Compare the others with this method; default: the first.")
    ] = "",
    plugin: PluginFiles = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the names of the files as one JSON object.")] = False,
) -> None:
    """Write the report of a study into its folder.

    The files are report.html, report.md, summary.csv and differences.csv.
    """
    from navloom.cli.output import print_json
    from navloom.runs.result_folder import failure_of

    from navloom_study.report.study_report import FILES, write_report

    made = write_report(folder, baseline)
    names = [name for name in FILES if name not in made.missing]
    if as_json:
        print_json({"out": str(folder), "files": names})
    elif names:
        typer.echo(f"written to {folder}: {', '.join(names)}")
    if made.missing:
        LOG.warning(failure_of(str(folder), names, made.missing))
        raise typer.Exit(1)
