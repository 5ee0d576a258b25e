"""Writes the report of a study: a self-contained HTML page, and the same tables in Markdown and CSV."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from matplotlib.figure import Figure
from navloom.files import write_each
from navloom.palette import GREY, OKABE_ITO
from navloom.runs.episode_trail import FALSE_SUCCESS, STRUCK

from navloom_study.episode_rows import Row
from navloom_study.report import html_page, report_tables
from navloom_study.report.figures import (
    difference_figures,
    distribution_figures,
    method_keys,
    outcome_figure,
    scatter_figure,
    success_figures,
    world_figures,
)
from navloom_study.report.html_page import Section
from navloom_study.report.open_loop_figures import open_loop_data, over_time_figure, shadow_summary, spread_figure
from navloom_study.report.plotting import svg_of
from navloom_study.report.report_tables import TextTable
from navloom_study.report.study_files import StudyFiles, read_study
from navloom_study.report.track_figures import failure_figure, ways_figures, worlds_shown
from navloom_study.statistics import THESE_WORLDS
from navloom_study.verdict import verdicts

__all__ = ["WrittenReport", "build_report", "write_report"]

FILES = ("report.html", "report.md", "summary.csv", "differences.csv")


@dataclass
class ReportPart:
    """One section of the report, in HTML and Markdown."""

    title: str
    html: list[str] = field(default_factory=list)
    markdown: list[str] = field(default_factory=list)

    def say(self, text: str, kind: str = "") -> None:
        """Add a paragraph."""
        self.html.append(html_page.paragraph(text, kind))
        self.markdown.append(f"{text}\n")

    def head(self, text: str) -> None:
        """Add a heading within the section."""
        self.html.append(html_page.heading(text))
        self.markdown.append(f"### {text}\n")

    def add(self, table: TextTable) -> None:
        """Add a table."""
        self.html.append(table.html())
        self.markdown.append(table.markdown())

    def fold(self, title: str, tables: Sequence[TextTable]) -> None:
        """Add tables that a click on the title shows."""
        body = "".join(table.html() for table in tables) or html_page.paragraph("Nothing.")
        self.html.append(html_page.folded(title, body))
        self.markdown.append(f"### {title}\n\n" + ("\n".join(table.markdown() for table in tables) or "Nothing.\n"))

    def points(self, entries: list[str]) -> None:
        """Add a list."""
        self.html.append(html_page.listing(entries))
        self.markdown.append("".join(f"- {entry}\n" for entry in entries))

    def draw(self, figures: Iterable[Figure | None], caption: str, keys: str = "", large: int = 0) -> None:
        """Add figures side by side to the HTML, see `html_page.panels`; Markdown has none."""
        panels = [(svg_of(figure), "") for figure in figures if figure is not None]
        if panels:
            self.html.append(html_page.panels(panels, caption, keys, large))


@dataclass(frozen=True)
class WrittenReport:
    """The texts of a report.

    Attributes:
        html, markdown: The whole report.
        summary_csv, differences_csv: Its numbers.
        missing: Why a file was not written, by name.
    """

    html: str
    markdown: str
    summary_csv: str
    differences_csv: str
    missing: Mapping[str, str] = field(default_factory=dict)


def write_report(folder: Path, baseline: str = "") -> WrittenReport:
    """Write the report of a study into its folder, each file atomically.

    Args:
        folder: Folder given to `navloom compare` as `--out`.
        baseline: Name of a method; default that of the open loop, else the first.

    Raises:
        ConfigError: Not a finished study, or no such method.
    """
    report = build_report(read_study(folder, baseline))
    contents = (report.html, report.markdown, report.summary_csv, report.differences_csv)
    return replace(report, missing=write_each(folder, dict(zip(FILES, contents, strict=True))))


def build_report(study: StudyFiles) -> WrittenReport:
    """The report of a study. It is reproducible, except for the section from `timing.json`."""
    parts = [_in_short(study), _outcomes(study), _results(study)]
    if "members" in study.request:
        parts.append(_members(study))
    if len(study.methods) > 1:
        parts.append(_differences(study))
    parts += [_ways(study), _failures(study), _worst(study)]
    if "open_loop" in study.request:
        parts.append(_open_loop(study))
    parts += [_conditions(study), _computing(study)]
    title = f"{' / '.join(study.methods)}" if len(study.methods) <= 3 else f"{len(study.methods)} methods compared"
    title = f"Study of {study.request['config']}: {title}"
    page = html_page.page(title, [Section(part.title, "\n".join(part.html)) for part in parts])
    text = f"# {title}\n\n" + "\n".join(f"## {part.title}\n\n" + "\n".join(part.markdown) for part in parts)
    return WrittenReport(page, text, report_tables.summary_csv(study), report_tables.differences_csv(study))


def _in_short(study: StudyFiles) -> ReportPart:
    part, found = ReportPart("Summary"), study.comparison
    for sentence in verdicts(found, study.metrics, study.untested):
        part.say(sentence, "verdict")
    part.say(
        f"{len(study.methods)} methods × {len(study.worlds)} worlds × {len(study.seeds)} seeds: {len(study.rows)} "
        f"closed-loop {'fleets' if 'members' in study.request else 'episodes'}, the same worlds, seeds, limits and "
        "robot for every method. "
        f"The others are compared with {study.baseline}."
    )
    if study.request.get("live"):
        part.say(
            "The episodes were driven live, each robot in its processes on the wall clock: two drives of one method "
            "differ, and so does their time if the machine is busy.",
            "note",
        )
    if found.scope == THESE_WORLDS:
        part.say(
            "For these worlds only: with fewer than 10 worlds, intervals and tests generalise to other seeds in the "
            "same worlds, not to other worlds.",
            "note",
        )
    else:
        part.say("Intervals and tests generalise to worlds like these: whole worlds are resampled.")
    total = len(study.tested) // len(study.methods)
    told = []
    for method in study.methods:
        wins = found.outcomes[method].get("succeeded", 0)
        line = f"{method}: {wins} of {total} succeeded"
        share = found.summary(method, "success") if study.metric("success") is not None else None
        if share is not None and share.low is not None:
            line += f" (95 % interval {report_tables.number(share.low, 3)} to {report_tables.number(share.high, 3)})"
        told.append(line)
    part.points(told)
    false = {method: found.outcomes[method].get(FALSE_SUCCESS, 0) for method in study.methods}
    if any(false.values()):
        counts = ", ".join(f"{count} of {total} with {method}" for method, count in false.items() if count)
        part.say(
            f"False successes: {counts}. The robot reported that it had arrived, but by ground truth it had not. "
            "They count as failures.",
            "note",
        )
    struck = {method: found.outcomes[method].get(STRUCK, 0) for method in study.methods}
    if any(struck.values()):
        counts = ", ".join(f"{count} of {total} with {method}" for method, count in struck.items() if count)
        part.say(f"Struck: {counts}. Something ran into the robot, and would have run into one that stands. Failures.")
    untold = {
        method: sum(
            row.key.method == method and row.outcome == "succeeded" and row.metrics.get("false_success") is None
            for row in study.tested
        )
        for method in study.methods
    }
    if any(untold.values()):
        counts = ", ".join(f"{count} of {total} with {method}" for method, count in untold.items() if count)
        part.say(f"Successes by the robot's own report only, without ground truth: {counts}.", "note")
    return part


def _outcomes(study: StudyFiles) -> ReportPart:
    part = ReportPart("Outcomes")
    part.draw(
        [outcome_figure(study), *success_figures(study)],
        f"How the episodes of each method ended{_where(study)}, and which succeeded by world and method.",
    )
    part.draw(
        [scatter_figure(study), *world_figures(study)],
        "Success against the time of the successful episodes: large each method, small each method in each world; "
        "what never succeeded is not there. Then means by world, of the episodes in which the metric is defined.",
        method_keys(study.methods),
    )
    part.add(report_tables.outcome_table(study))
    failures = report_tables.reasons(study)
    if failures.rows:
        part.add(failures)
    return part


def _results(study: StudyFiles) -> ReportPart:
    part, few = ReportPart("Metrics"), study.comparison.scope == THESE_WORLDS
    part.say(
        "Mean over worlds of the mean within each, with its 95 % interval: exact for success and other shares, else a "
        f"BCa bootstrap of {study.comparison.resamples} resamples of "
        f"{'episodes within their worlds' if few else 'whole worlds'}. "
        "↑ more is better, ↓ less is better. An episode in which a metric is not defined is left out, and the cell "
        "gives the number of the others; success, spl, scores and time are defined for every episode, failed ones too."
    )
    for table in report_tables.results(study):
        part.add(table)
    part.draw(
        distribution_figures(study),
        "Distribution over all episodes in which the metric is defined: share at or below each value.",
        method_keys(study.methods),
    )
    return part


def _members(study: StudyFiles) -> ReportPart:
    part = ReportPart("Members")
    part.say(
        "Means over the fleets. An episode of this study is the drive of a fleet: it is one value in every interval "
        "and one half of every pair. The members of one fleet depend on each other, so their rows have no intervals."
    )
    part.fold(
        f"{len(study.request['members'])} members", [report_tables.members(study, method) for method in study.methods]
    )
    return part


def _differences(study: StudyFiles) -> ReportPart:
    part = ReportPart(f"Differences from {study.baseline}")
    part.say(
        "Paired by world and seed: method minus baseline. Below each are the interval and the p-value of one sign-flip "
        "permutation test: 0 is outside of the interval exactly if p is at most 0.05, marked *. The primary metric of "
        "each method is in the first table, adjusted over the methods after Holm; its interval has the level of its "
        "step. All others are exploratory: 95 % intervals and unadjusted p-values, of which one in 20 is below 0.05 "
        "without any difference. Metrics without a better direction are not tested. Where the number of pairs cannot "
        "give a p of 0.05, the smallest attainable one is named, and there may be no interval."
    )
    part.draw(
        difference_figures(study),
        f"Difference from {study.baseline} with the interval of its test; filled where 0 is outside.",
        html_page.legend([("better", OKABE_ITO[0], ""), ("worse", OKABE_ITO[1], ""), ("not told apart", GREY, "")]),
    )
    for table in report_tables.differences(study):
        part.add(table)
    return part


def _ways(study: StudyFiles) -> ReportPart:
    part = ReportPart("Tracks")
    shown = worlds_shown(study)
    if not shown:
        part.say("Nothing to draw: in no stored track did a robot drive 0.1 m.")
    for what, ways in shown:
        unseen = "" if study.world(ways.world) is not None else f" {study.why_no_world(ways.world)}"
        part.draw(
            ways_figures(study, ways),
            f"{ways.world}, {what} by success of all methods, among those in which a robot drove. First {ways.seeds} "
            "seeds; numbers: successes of all seeds. Disc: start; star: goal; cross: ended without success. Dark: what "
            "the robot can touch; pale: above or below it; hatched: appears later; outlined with a dotted line: "
            f"moves.{unseen}",
            method_keys(study.methods),
            large=1 if len(study.methods) > 1 else 0,
        )
    return part


def _failures(study: StudyFiles) -> ReportPart:
    """A gallery of failed episodes, each with its command."""
    part, told = ReportPart("Failures"), report_tables.failures(study)
    if not told:
        part.say("No episode failed.")
        return part
    total = sum(row.outcome != "succeeded" for row in study.tested)
    part.say(
        f"{len(told)} of {total} failed episodes: of each method the first of each outcome in each world, methods in "
        "turn. The command drives it again."
    )
    drawn: list[tuple[str, str]] = []
    for row in told:
        words = f"{row.key.method}, {row.key.world}, seed {row.key.seed}: {row.outcome}, {row.reason}"
        command = study.command(row.key.method, row.key.world, row.key.seed)
        part.markdown.append(f"- {words}\n  `{command}`\n")
        drawn.append((_failure_svg(study, row), html_page.paragraph(words) + html_page.code(command)))
    part.html.append(html_page.panels(drawn, "Failed episodes.", large=0))
    return part


def _failure_svg(study: StudyFiles, row: Row) -> str:
    figure = failure_figure(study, row)
    return html_page.paragraph("No picture: the robot did not drive.") if figure is None else svg_of(figure)


def _where(study: StudyFiles) -> str:
    """A remark where worlds that tested nothing are left out."""
    return " in the worlds that tested the methods" if study.untested else ""


def _worst(study: StudyFiles) -> ReportPart:
    part = ReportPart("Worst worlds")
    part.say(
        "The five worst worlds of each method, by success, then SPL, each with the command that repeats its worst "
        "episode."
    )
    for method in study.methods:
        part.head(method)
        part.add(report_tables.worst_worlds(study, method))
    return part


def _open_loop(study: StudyFiles) -> ReportPart:
    part, data = ReportPart("On the same inputs"), open_loop_data(study)
    assert data is not None
    part.say(
        f"Open loop: {data.baseline} drove once more in each world with each seed, and the others ran in shadow on "
        "the same inputs. Their answers moved nothing; they are compared with the baseline's tick by tick."
    )
    told = study.request["open_loop"]
    for method, why in told["left_out"].items():
        part.say(f"{method} is left out: it {why}.", "note")
    lost = len(study.worlds) * len(study.seeds) - len({(line.world, line.seed) for line in study.open_loop})
    if lost:
        part.say(f"{lost} open-loop episodes failed and are left out; journal.jsonl gives the reason.", "note")
    if data.changed:
        part.say(
            f"{data.changed} of {data.compared} episodes differ from the baseline's alone: not comparable.", "note"
        )
    else:
        part.say(f"The traces of all {data.compared} episodes are those of the baseline alone, bit for bit.")
    part.add(shadow_summary(study, data))
    part.draw(
        [spread_figure(study, data)],
        "Disagreement with the baseline over all ticks of all worlds: median, middle half, 5 to 95 %. Dotted: what "
        "counts as the same; values below a tenth of it are drawn there.",
    )
    over_time = over_time_figure(study, data)
    if over_time is not None:
        figure, worlds = over_time
        left = len(study.worlds) - len(worlds)
        more = f" The {len(worlds)} worlds with the largest disagreement." if left else ""
        part.draw([figure], f"Disagreement over time, RMS over seeds of each half second.{more}")
    return part


def _conditions(study: StudyFiles) -> ReportPart:
    part = ReportPart("What was held constant, and what differs")
    part.say("Computed from the methods' full configs with every default, not declared.")
    part.say(f"Seeds: {', '.join(map(str, study.seeds))}.")
    differing = len(study.request["differs"])
    part.fold(f"Differs ({differing} settings)", [report_tables.differs(study)] if differing else [])
    methods = report_tables.method_settings(study)
    if methods.rows:
        part.fold("Settings of the methods", [methods])
    part.fold("Held constant", [report_tables.held_equal(study)])
    part.fold("Configs, worlds and versions", [*report_tables.hashes(study), report_tables.versions(study)])
    return part


def _computing(study: StudyFiles) -> ReportPart:
    part = ReportPart("Compute time")
    part.say("Wall-clock figures of this machine, from timing.json. The rest of this report is reproducible.")
    if not study.timing:
        part.say("timing.json is missing.", "note")
        return part
    part.add(report_tables.timings(study))
    machine = study.timing.get("machine", {})
    part.say(
        f"{study.timing.get('wall_s', 0.0):.0f} s in all with {study.timing.get('jobs', '?')} processes on "
        f"{machine.get('cores', '?')} cores ({machine.get('processor', '?')}).{_load(study)}"
    )
    return part


def _load(study: StudyFiles) -> str:
    """How busy the machine was while the episodes ran."""
    loads = sorted(entry["load"] for entry in study.timing.get("episodes", ()) if "load" in entry)
    if not loads:
        return ""
    return f" Load of the machine while they ran: median {loads[len(loads) // 2]:.1f}, at most {loads[-1]:.1f}."
