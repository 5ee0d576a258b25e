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
    tex: Annotated[
        bool, typer.Option("--tex", help="Also write tables in LaTeX and figures in PDF for a paper, into DIR/tex.")
    ] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Also write tables of one line a method, into DIR/csv.")] = False,
    plugin: PluginFiles = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the names of the files as one JSON object.")] = False,
) -> None:
    """Write the report of a study into its folder.

    The files are report.html, report.md, summary.csv and differences.csv. With --tex, tex/paper.tex compiles alone and
    shows every table and figure; with --csv, csv/statistics.txt has the sentence on statistics too.
    """
    from navloom.cli.output import print_json
    from navloom.files import make_writable, write_each
    from navloom.runs.result_folder import failure_of

    from navloom_study.report.paper_files import csv_files, tex_files
    from navloom_study.report.study_files import read_study
    from navloom_study.report.study_report import FILES, write_report

    made = write_report(folder, baseline)
    names = [name for name in FILES if name not in made.missing]
    missing = dict(made.missing)
    for kind in [name for name, is_asked in {"tex": tex, "csv": csv}.items() if is_asked]:
        study = read_study(folder, baseline)
        contents = tex_files(study) if kind == "tex" else csv_files(study)
        make_writable(folder / kind)
        failed = write_each(folder / kind, contents)
        missing |= {f"{kind}/{name}": why for name, why in failed.items()}
        names += [f"{kind}/{name}" for name in contents if name not in failed]
    if as_json:
        print_json({"out": str(folder), "files": names})
    elif names:
        typer.echo(f"written to {folder}: {', '.join(names)}")
    if missing:
        LOG.warning(failure_of(str(folder), names, missing))
        raise typer.Exit(1)
