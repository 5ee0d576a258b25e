"""Tables, figures and the sentence on statistics of a study for one's own paper: LaTeX with PDF figures, and CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from navloom.runs.metrics import headlines

from navloom_study.report import report_tables
from navloom_study.report.figures import (
    difference_figures,
    distribution_figures,
    line_of,
    outcome_figure,
    scatter_figure,
)
from navloom_study.report.plotting import pdf_of, styled
from navloom_study.report.report_tables import TextTable
from navloom_study.report.study_files import StudyFiles
from navloom_study.statistics import THESE_WORLDS
from navloom_study.verdict import verdicts

__all__ = ["csv_files", "latex", "statistics_sentence", "tex_files"]

LETTERS = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#", "$": r"\$",
    "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "<": "$<$", ">": "$>$", "|": "$|$", "−": "$-$", "–": "--",
    "—": "---", "↑": r"$\uparrow$", "↓": r"$\downarrow$", "≤": r"$\leq$", "≥": r"$\geq$", "×": r"$\times$",
    "·": r"$\cdot$", "²": r"$^2$", "σ": r"$\sigma$", "µ": r"$\mu$", "√": r"$\surd$", "…": r"\ldots{}", "°": r"$^\circ$",
    "“": "``", "”": "''",
}  # fmt: skip
MAIN = r"""% Compiles alone; or \input the tables and \includegraphics the figures in your paper.
\documentclass[a4paper]{article}
\usepackage[margin=20mm]{geometry}
\usepackage{booktabs}
\usepackage{graphicx}
\begin{document}
%s
\end{document}
"""


def latex(text: str) -> str:
    """A text for LaTeX: its special letters escaped, and letters that few fonts have written in mathematics."""
    return "".join(LETTERS.get(letter, letter if letter.isascii() else "?") for letter in text)


def statistics_sentence(study: StudyFiles) -> str:
    """How intervals and tests were computed, for the section on methods of a paper."""
    found, worlds, seeds = study.comparison, len({row.key.world for row in study.tested}), len(study.seeds)
    unit = "episodes within these worlds" if found.scope == THESE_WORLDS else "whole worlds"
    asked = next((one.metric for one in found.differences if one.is_primary), None)
    parts = [
        f"Each method drove {worlds} worlds with {seeds} {'seed' if seeds == 1 else 'seeds'} each, all methods with "
        "the same worlds, seeds and limits.",
        "Values are means over worlds with 95 % intervals: exact for shares (Clopper and Pearson, with the effective "
        f"number of independent trials), else a BCa bootstrap of {found.resamples} resamples of {unit}.",
    ]
    if len(study.methods) > 1:
        primary = f"; p of the primary metric ({asked}) is adjusted over the methods after Holm" if asked else ""
        parts.append(
            f"Differences from {study.baseline} are paired by world and seed and tested by sign-flip permutation, "
            f"two-sided{primary}; all other metrics are exploratory."
        )
    if found.scope == THESE_WORLDS:
        parts.append("With fewer than ten worlds, the intervals hold for these worlds only.")
    return " ".join(parts)


def tex_files(study: StudyFiles) -> dict[str, str | bytes]:
    """LaTeX files and PDF figures by name; `paper.tex` shows all of them and compiles alone (booktabs, graphicx)."""
    files: dict[str, str | bytes] = {"statistics.tex": latex(statistics_sentence(study)) + "\n"}
    files["verdict.tex"] = "\n\n".join(map(latex, verdicts(study.comparison, study.metrics, study.untested))) + "\n"
    body = [r"\input{statistics}", r"\input{verdict}"]
    for name, table in _tables(study):
        files[f"{name}.tex"] = _tabular(table)
        kind = name.partition("-")[0]
        caption = latex(f"{CAPTIONS[kind]} {table.caption if kind == 'differences' else ''}".strip())
        body.append(f"\\begin{{table}}[htbp]\\centering\n\\caption{{{caption}}}\n\\input{{{name}}}\n\\end{{table}}")
    for name, figure in _figures(study):
        files[f"{name}.pdf"] = pdf_of(figure)
        width, text = figure.get_size_inches()[0] * 25.4, 170.0
        size = r"\linewidth" if width >= text else f"{width / text:.2f}\\linewidth"
        body.append(f"\\begin{{figure}}[htbp]\\centering\n\\includegraphics[width={size}]{{{name}}}\n"
                    f"\\caption{{{latex(CAPTIONS[name.partition('-')[0]])}}}\n\\end{{figure}}")  # fmt: skip
    files["paper.tex"] = MAIN.replace("%s", "\n".join(body))
    return files


CAPTIONS = {
    "outcomes": "How the episodes of each method ended.",
    "metrics": "Mean over worlds with its 95 % interval; arrows point to the better side.",
    "differences": "Differences from the baseline with the interval of their test.",
    "distributions": "Share of the episodes at or below each value.",
    "success": "Success against the time of the successful episodes, by method and world.",
}


def _tables(study: StudyFiles) -> Iterator[tuple[str, TextTable]]:
    """The report's tables, of the chief metrics only, so that each fits a page; `csv` has all."""
    primary = [one.metric for one in study.comparison.differences if one.is_primary]
    chief = {*headlines([metric.name for metric in study.metrics]), *primary}
    heads = {report_tables.head(metric) for metric in study.metrics if metric.name in chief}
    yield "outcomes", report_tables.outcome_table(study)
    for number, table in enumerate(report_tables.results(study), 1):
        yield f"metrics-{number}", replace(table, rows=[row for row in table.rows if row[0] in heads])
    for number, table in enumerate(report_tables.differences(study) if len(study.methods) > 1 else [], 1):
        is_primary = table.columns[0] == "method"
        kept = [row for row in table.rows if is_primary or row[0] in heads]
        yield f"differences-{number}", replace(table, rows=kept)


def _figures(study: StudyFiles) -> Iterator[tuple[str, Figure]]:
    yield "outcomes-by-method", outcome_figure(study)
    if (figure := scatter_figure(study)) is not None:
        yield "success-and-time", _with_keys(figure, study.methods)
    for number, figure in enumerate(difference_figures(study) if len(study.methods) > 1 else [], 1):
        yield f"differences-figure-{number}", figure
    for number, figure in enumerate(distribution_figures(study), 1):
        yield f"distributions-{number}", _with_keys(figure, study.methods)


@styled()
def _with_keys(figure: Figure, methods: Sequence[str]) -> Figure:
    """The figure with the names of its lines below, which the report has once for several figures."""
    lines = [Line2D([], [], label=method, **line_of(number)) for number, method in enumerate(methods)]
    figure.set_figheight(figure.get_figheight() + 0.18 * math.ceil(len(lines) / 3))
    figure.legend(handles=lines, loc="outside lower center", ncols=3)
    return figure


def _tabular(table: TextTable) -> str:
    """A table in the style of booktabs; further lines of a cell, as intervals, stand below it in small type."""
    columns = "".join("l" if k in table.text else "r" for k in range(table.wide))
    lines = [rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}", r"\toprule", " & ".join(map(latex, table.columns)) + r" \\"]
    lines.append(r"\midrule")
    for row in table.rows:
        cells = [cell.split("\n") for cell in row]
        for k in range(max(map(len, cells))):
            texts = [latex(cell[k]) if k < len(cell) else "" for cell in cells]
            small = [rf"{{\footnotesize {text}}}" if text and k else text for text in texts]
            lines.append(" & ".join(small) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def csv_files(study: StudyFiles) -> dict[str, str | bytes]:
    """CSV files by name: one line a method, for plots and tables of one's own, with the ends of the intervals."""
    metrics = study.table_metrics
    heads = ["method", *(f"{m.name}{end}" for m in metrics for end in ("", "_low", "_high"))]
    lines = [heads]
    for method in study.methods:
        ends = (study.comparison.summary(method, metric.name) for metric in metrics)
        lines.append([method, *(_told(value) for one in ends for value in (one.mean, one.low, one.high))])
    outcomes = report_tables.outcome_table(study)
    files = {"metrics.csv": lines, "outcomes.csv": [[*outcomes.columns], *map(list, outcomes.rows)]}
    return {**{name: _csv(table) for name, table in files.items()}, "statistics.txt": statistics_sentence(study) + "\n"}


def _told(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _csv(lines: list[list[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()
