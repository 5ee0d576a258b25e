"""Tables of a study's report, for HTML, Markdown and CSV."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from navloom.runs.metrics import METRICS, Metric
from navloom.runs.people_metrics import PEOPLE_METRICS

from navloom_study.episode_rows import Row
from navloom_study.fleet_episodes import OF_MEMBERS, member_summary
from navloom_study.report import html_page
from navloom_study.report.study_files import StudyFiles
from navloom_study.statistics import Difference, Estimate

__all__ = ["TextTable", "decimals", "differences_csv", "summary_csv"]

ABREAST = 6
"""Most methods side by side on an A4 page."""
NONE = "–"
PLACE = re.compile(r"\(-?\d+\.\d+, -?\d+\.\d+\)")
DISTANCE = re.compile(r"\d+\.\d m (?=from the goal by ground truth)")


@dataclass(frozen=True)
class TextTable:
    """A table of texts.

    Attributes:
        columns: Column heads.
        rows: Rows with one cell for each column; further lines of a cell are details.
        caption: Caption above the table.
        text: Indices of text columns; all others hold numbers.
        marked: Indices of highlighted rows.
        code: Indices of columns with commands.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    text: Sequence[int] = (0,)
    marked: Sequence[int] = ()
    code: Sequence[int] = ()

    def html(self) -> str:
        """The table as HTML."""
        return html_page.table(self.columns, self.rows, self.caption, self.text, self.marked, self.code)

    def markdown(self) -> str:
        """The table as GitHub Markdown."""
        lines = [
            [_flat(name) for name in self.columns],
            ["---" if k in self.text else "---:" for k in range(self.wide)],
        ]
        lines += [[f"`{_flat(c)}`" if k in self.code else _flat(c) for k, c in enumerate(row)] for row in self.rows]
        body = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        return f"{self.caption}\n\n{body}\n" if self.caption else f"{body}\n"

    @property
    def wide(self) -> int:
        """Number of columns."""
        return len(self.columns)


def _flat(cell: str) -> str:
    first, *more = cell.split("\n")
    return (first + (f" ({'; '.join(more)})" if more else "")).replace("|", "\\|")


def decimals(values: Sequence[float | None]) -> int:
    """Decimal places for numbers of this size: three significant digits of the largest, at most three places."""
    greatest = max((abs(value) for value in values if value is not None), default=0.0)
    return 3 if greatest < 1.0 else 2 if greatest < 10.0 else 1 if greatest < 100.0 else 0


def number(value: float | None, digits: int) -> str:
    """A number as text; a value that rounds to 0 has no sign."""
    if value is None:
        return NONE
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if not text.strip("-0.") else text.replace("-", "−")


def head(metric: Metric) -> str:
    """Name of a metric with its unit and an arrow for the better direction."""
    side = {"higher": "↑", "lower": "↓", None: ""}[metric.better]
    unit = "" if metric.unit == "1" else f", {metric.unit}"
    return f"{metric.name}{unit} {side}".strip()


def results(study: StudyFiles) -> list[TextTable]:
    """The metrics of every method with their intervals, at most `ABREAST` methods a table."""
    found = study.comparison
    blocks = [study.methods[k : k + ABREAST] for k in range(0, len(study.methods), ABREAST)]
    total = len(study.tested) // len(study.methods)
    tables = []
    for block in blocks:
        rows = []
        for metric in study.table_metrics:
            estimates = [found.summary(method, metric.name) for method in block]
            every = [found.summary(method, metric.name).mean for method in study.methods]
            if metric in PEOPLE_METRICS and all(mean is None for mean in every):
                continue  # most studies have no people
            digits = decimals(every)
            rows.append([head(metric), *(_estimated(estimate, digits, total) for estimate in estimates)])
        tables.append(TextTable(["metric", *block], rows))
    return tables


def _estimated(estimate: Estimate, digits: int, total: int) -> str:
    told = number(estimate.mean, digits)
    if estimate.low is not None:
        told += f"\n{number(estimate.low, digits)} to {number(estimate.high, digits)}"
    if 0 < estimate.episodes < total:
        told += f"\nof {estimate.episodes} episodes"
    return told


def members(study: StudyFiles, method: str) -> TextTable:
    """The members of a fleet with one method: how many of its drives each finished, and means."""
    found = member_summary([row for row in study.tested if row.key.method == method], study.request["member_metrics"])
    shown = [metric for metric in METRICS if metric.name in OF_MEMBERS]
    digits = {m.name: decimals([one["means"][m.name] for one in found.values()]) for m in shown}
    rows = [
        [name, f"{one['outcomes'].get('succeeded', 0)} of {one['episodes']}"]
        + [number(one["means"][metric.name], digits[metric.name]) for metric in shown]
        for name, one in found.items()
    ]
    return TextTable(["member", "succeeded", *map(head, shown)], rows, method)


def differences(study: StudyFiles) -> list[TextTable]:
    """The primary differences from the baseline, then the others, at most `ABREAST` methods a table."""
    found, others = study.comparison, [name for name in study.methods if name != study.baseline]
    asked = {d.method: d for d in found.differences if d.is_primary}
    lines = [
        [method, head(metric), *_difference(one, decimals([one.estimate.mean])).split("\n", 1)]
        for method, one in asked.items()
        if (metric := study.metric(one.metric)) is not None
    ]
    tables = [TextTable(["method", "metric", "difference", "interval and test"],
                        lines, "Primary.", (0, 1, 3))] if lines else []  # fmt: skip
    for block in (others[k : k + ABREAST] for k in range(0, len(others), ABREAST)):
        rows = []
        for metric in study.table_metrics:
            every = [found.difference(method, metric.name) for method in others]
            if all(one.estimate.mean is None or one.is_primary for one in every):
                continue
            digits = decimals([one.estimate.mean for one in every])
            cells = [found.difference(method, metric.name) for method in block]
            rows.append([head(metric), *("above" if one.is_primary else _difference(one, digits) for one in cells)])
        tables.append(TextTable(["metric", *block], rows, f"Exploratory.{_attainable(study)}"))
    return tables


def _attainable(study: StudyFiles) -> str:
    """What the number of pairs allows at best, if that is no p of 0.05."""
    told = [d.attainable for d in study.comparison.differences if d.attainable is not None]
    if not told or min(told) <= 0.05:
        return ""
    return f" These pairs cannot give a p below {chance(min(told))} in any metric."


def _difference(difference: Difference, digits: int) -> str:
    mean, low, high = difference.estimate.mean, difference.estimate.low, difference.estimate.high
    told = number(mean, digits) + (" *" if difference.is_shown else "")
    if low is not None:
        level = f" ({100.0 * difference.level:.3g} %)" if difference.is_primary else ""
        told += f"\n{number(low, digits)} to {number(high, digits)}{level}"
    p = difference.p_holm if difference.is_primary else difference.p
    if p is not None:
        told += f"\np {chance(p)}"
    if difference.is_primary and not difference.can_be_shown:
        told += f" (attainable {chance(difference.attainable)})"
    if difference.unpaired or difference.is_primary:
        told += f"\n{difference.estimate.episodes} pairs"
    return told


def worst_worlds(study: StudyFiles, method: str) -> TextTable:
    """The worst worlds of a method, with the command that repeats its worst episode there."""
    rows = [
        [one.world, f"{one.failures} of {one.episodes}", str(one.seed), one.outcome,
         study.command(method, one.world, one.seed)]
        for one in study.comparison.worst[method]
    ]  # fmt: skip
    return TextTable(["world", "failed", "seed", "ended", "again"], rows, "", (0, 3, 4), (), (4,))


def chance(value: float | None) -> str:
    """A p-value as text."""
    return NONE if value is None else "< 0.001" if value < 0.001 else f"{value:.3f}"


def outcome_table(study: StudyFiles) -> TextTable:
    """Number of episodes by method and outcome."""
    counts = study.comparison.outcomes
    kinds = [kind for kind, _ in Counter(row.outcome for row in study.rows).most_common()]
    kinds.sort(key=lambda kind: kind != "succeeded")
    rows = [[method, *(str(counts[method].get(kind, 0)) for kind in kinds)] for method in study.methods]
    return TextTable(["method", *kinds], rows, "Episodes by outcome.")


def reasons(study: StudyFiles, most: int = 12) -> TextTable:
    """Why episodes failed, the most common reasons first; places and distances, which vary, are left out."""
    told = Counter(
        (row.key.method, row.outcome, DISTANCE.sub("… m ", PLACE.sub("(…)", row.reason)))
        for row in study.tested
        if row.outcome != "succeeded"
    )
    rows = [
        [method, outcome, reason, str(count)]
        for (method, outcome, reason), count in sorted(told.items(), key=lambda entry: (-entry[1], entry[0]))[:most]
    ]
    more = f" The {most} commonest of {len(told)}." if len(told) > most else ""
    return TextTable(["method", "outcome", "reason", "episodes"], rows, f"Why episodes failed.{more}", (0, 1, 2))


def failures(study: StudyFiles, most: int = 12) -> list[Row]:
    """Failed episodes to show: of each method the first of each outcome in each world, methods in turn."""
    by_method: dict[str, dict[tuple[str, str], Row]] = {method: {} for method in study.methods}
    for row in study.tested:
        if row.outcome != "succeeded":
            by_method[row.key.method].setdefault((row.outcome, row.key.world), row)
    turns = zip_longest(*(kinds.values() for kinds in by_method.values()))
    return [row for turn in turns for row in turn if row is not None][:most]


def versions(study: StudyFiles) -> TextTable:
    """Versions of everything that an episode depends on."""
    rows = [[name, value] for name, value in study.request["versions"].items()]
    return TextTable(["what", "version"], rows, "", (0, 1))


def hashes(study: StudyFiles) -> list[TextTable]:
    """Hashes of each method's config and of each world."""
    methods = [[name, told["config_sha256"][:16]] for name, told in study.request["methods"].items()]
    worlds = [[name, told["sha256"][:16]] for name, told in study.request["worlds"].items()]
    return [
        TextTable(["method", "config_sha256"], methods, "First 16 digits; whole in study.json.", (0, 1)),
        TextTable(["world", "sha256"], worlds, "", (0, 1)),
    ]


def held_equal(study: StudyFiles) -> TextTable:
    """Every config value that is equal for all methods."""
    told = [[place, brief(value)] for place, value in study.request["held_equal"].items()]
    half = (len(told) + 1) // 2
    rows = [[*left, *(told[half + k] if half + k < len(told) else ["", ""])] for k, left in enumerate(told[:half])]
    return TextTable(["place", "value", "place", "value"], rows, "", (0, 1, 2, 3))


def differs(study: StudyFiles) -> TextTable:
    """Every config value that differs between methods."""
    rows = []
    for place, values in study.request["differs"].items():
        by_value: dict[str, list[str]] = {}
        for method, value in values.items():
            by_value.setdefault(brief(value), []).append(method)
        rows.append([place, "; ".join(f"{value}: {', '.join(names)}" for value, names in by_value.items())])
    return TextTable(["place", "value: methods"], rows, "", (0, 1))


def method_settings(study: StudyFiles) -> TextTable:
    """What each `[[method]]` of the config sets; no rows if the study has none."""
    rows = [
        [name, place, brief(value)]
        for name, told in study.request["methods"].items()
        for place, value in told.get("set", {}).items()
    ]
    return TextTable(["method", "place", "value"], rows, "As in the config's [[method]], before --set.", (0, 1, 2))


def brief(value: object) -> str:
    """A config value as text, cut if it is long."""
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 48 else f"{text[:47]}…"


def timings(study: StudyFiles) -> TextTable:
    """Wall time of control steps by method; a method that is too slow in any episode is highlighted."""
    by_method: dict[str, list[dict[str, float]]] = {method: [] for method in study.methods}
    for entry in study.timing.get("episodes", []):
        if entry.get("method") in by_method and "tick_us_p50" in entry:
            by_method[entry["method"]].append(entry)
    rows, marked = [], []
    for method, told in by_method.items():
        if not told:
            rows.append([method, *[NONE] * 6])
            continue
        late = sum(bool(entry["too_slow"]) for entry in told)
        marked += [len(rows)] if late else []
        middle = [float(np.median([entry[f"tick_us_{name}"] for entry in told])) for name in ("p50", "p95", "p99")]
        worst = max(entry["tick_us_max"] for entry in told)
        note = f"{late} of {len(told)}" + (" — too slow" if late else "")
        cpu = [entry["tick_cpu_us_p99"] for entry in told if "tick_cpu_us_p99" in entry]
        computed = f"{float(np.median(cpu)):.0f}" if cpu else NONE
        rows.append([method, *(f"{value:.0f}" for value in (*middle, worst)), computed, note])
    period = study.value("run.period")
    allowed = f" The control period is {float(period) * 1e6:.0f} µs." if period is not None else ""
    caption = (
        "µs a control step took, all nodes but the simulator: median over the episodes of the percentile within each, "
        f"and the longest step of all, by the clock; then the CPU time, which decides whether a method is too slow, "
        f"since other programs lengthen only the former.{allowed}"
    )
    columns = ["method", "p50", "p95", "p99", "longest", "p99 of CPU time", "episodes above the period"]
    return TextTable(columns, rows, caption, (0,), marked)


def summary_csv(study: StudyFiles) -> str:
    """Every metric of every method, one a line, as CSV: numbers with 12 digits, empty if undefined."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "metric", "unit", "better", "mean", "low", "high", "worlds", "episodes"])
    for method in study.methods:
        for metric in study.metrics:
            one = study.comparison.summary(method, metric.name)
            told = [_told(value) for value in (one.mean, one.low, one.high)]
            writer.writerow([method, metric.name, metric.unit, metric.better or "", *told, one.worlds, one.episodes])
    return text.getvalue()


def differences_csv(study: StudyFiles) -> str:
    """Every difference from the baseline, one a line, as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = ["method", "baseline", "metric", "unit", "better", "difference", "low", "high", "level", "p", "p_holm"]
    writer.writerow([*heads, "attainable_p", "worlds", "pairs", "unpaired"])
    for difference in study.comparison.differences:
        metric = study.metric(difference.metric)
        assert metric is not None
        numbers = (
            difference.estimate.mean,
            difference.estimate.low,
            difference.estimate.high,
            difference.level,
            difference.p,
            difference.p_holm,
            difference.attainable,
        )
        told = [
            difference.method,
            study.baseline,
            difference.metric,
            metric.unit,
            metric.better or "",
            *map(_told, numbers),
        ]
        writer.writerow([*told, difference.estimate.worlds, difference.estimate.episodes, difference.unpaired])
    return text.getvalue()


def _told(value: float | None) -> str:
    return "" if value is None else f"{value:.12g}"
