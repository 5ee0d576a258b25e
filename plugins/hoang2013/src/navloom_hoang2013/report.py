"""The reproduction of Hoang et al. 2013 as one page: numbers, figures, errata, and how it was made."""

from __future__ import annotations

import platform
import re
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import navloom_study.report as html
import numpy as np

from navloom_hoang2013.cloud import hits_by_box
from navloom_hoang2013.drive_readings import DriveReadings
from navloom_hoang2013.errata import Errata, Variant, length_of
from navloom_hoang2013.law import BAND
from navloom_hoang2013.measured import statements_of
from navloom_hoang2013.plates import Plate, Reproduction
from navloom_hoang2013.seeds import Tally
from navloom_hoang2013.statements import Statement

__all__ = ["page_of"]

PAPER = (
    "T. T. Hoang, D. T. Hiep, P. M. Duong, N. T. T. Van, B. G. Duong, T. Q. Vinh: Proposal of Algorithms for "
    "Navigation and Obstacles Avoidance of Autonomous Mobile Robot. ICIEA 2013, arXiv 1611.09436."
)


SECTIONS = (
    ("Figures 6 and 7: what the laser sees", ("figure-06", "figure-07")),
    ("Figures 8 and 9: map and plan", ("figure-08", "figure-09")),
    ("Figure 10: tracking", ("figure-10", "figure-10-speeds")),
    ("Figures 11 and 12: the unexpected obstacle", ("figure-11a", "figure-11b", "figure-12")),
)
EXPECTED = {"girder A": 230, "girder B": 177, "floor": 772, "ceiling": 1801, "no return": 0}
"""Number of rays of the sweep without noise by the object they hit, from the study made beforehand. Its room had no
ceiling: what the ceiling meets here met nothing."""


def page_of(made: Reproduction, drawings: Sequence[tuple[Plate, str]]) -> str:
    """The report as one HTML page.

    Args:
        made: The reproduction.
        drawings: Each figure with its SVG.
    """
    figures = {plate.stem: html.figure(_fitting(svg), f"{plate.title} {plate.caption}") for plate, svg in drawings}
    sections = [html.Section("The statements", _statements(statements_of(made)))]
    for title, stems in SECTIONS:
        parts = [figures[stem] for stem in stems if stem in figures]
        sections.append(html.Section(title, _beside(parts)))
    sections += _errata_sections(made, figures)
    sections.append(html.Section("How this was made", _provenance(made)))
    return html.page("The experiment of Hoang et al. 2013, reproduced", sections, _lead(made))


def _fitting(svg: str) -> str:
    """The SVG, scaled to the width of its container."""
    return re.sub(r'(<svg[^>]*?) width="[^"]*" height="[^"]*"', r'\1 width="100%"', svg, count=1)


def _beside(parts: Sequence[str]) -> str:
    """Parts of about one column's width, side by side if the page is wide enough."""
    cells = "".join(f'<div style="flex:1 1 86mm;max-width:120mm">{part}</div>' for part in parts)
    return f'<div style="display:flex;flex-wrap:wrap;gap:0 1.2rem;align-items:flex-start">{cells}</div>\n'


def _lead(made: Reproduction) -> str:
    run, free = made.run.episode.summary(), made.free.episode.summary()
    return html.paragraph(PAPER) + html.listing(
        [
            f"The plan: {length_of(made.run)}. The paper's robot took gate B.",
            f"Without an obstacle the robot {_end(free)}, cross-track error {_cm(free['cross_track_rms_m'])} cm rms.",
            f"With the unexpected obstacle O it {_end(run)}, with {run['collisions']} contacts and "
            f"{run['min_clearance_m']:.2f} m of clearance.",
            "The paper's text survives, its figures do not: where it gives no number the table says so, and the sizes "
            "of the room and the place of O are ours.",
        ]
    )


def _cm(metres: float) -> str:
    return f"{100.0 * metres:.1f}"


def _end(summary: dict[str, Any]) -> str:
    if summary["truly_reached"]:
        return f"arrives at D after {summary['sim_time_s']:.1f} s, {summary['goal_error_m']:.2f} m from it"
    if summary["outcome"] == "succeeded":
        return f"does not arrive: it says so {summary['goal_error_m']:.1f} m from D"
    return f"does not arrive: {summary['outcome']}, {summary['reason']}"


def _statements(statements: Sequence[Statement]) -> str:
    rows = [
        (
            statement.id,
            "\n".join([statement.printed, *(_key(key, statement) for key in statement.keys)]),
            f"{statement.ours}\n{statement.why}" if statement.why else statement.ours,
            f"{statement.verdict}\n{statement.figure}" if statement.figure else statement.verdict,
            f"{statement.code.rpartition(':')[2]}\n{statement.code.partition(':')[0]}\n"
            f"{statement.test.rpartition('::')[2]}",
        )
        for statement in statements
    ]
    names = ("", "printed, and its keys", "ours, and why", "verdict, figure", "code, and test")
    tally = Counter(statement.verdict for statement in statements)
    counts = ", ".join(f"{number} {verdict}" for verdict, number in tally.most_common())
    return html.table(names, rows, f"{len(statements)} statements: {counts}", text=range(len(names)))


def _key(key: str, statement: Statement) -> str:
    return f"{key} (not active)" if key in statement.inactive else key


def _errata_sections(made: Reproduction, figures: dict[str, str]) -> list[html.Section]:
    errata = made.errata
    return [
        html.Section(
            "What the errata change: order of the filters, and geometry",
            _beside([figures["errata-order"], figures["errata-geometry"]]) + _pixel_table(errata),
        ),
        html.Section("What the errata change: the grid", _beside([figures["errata-grid"], _grid_table(errata)])),
        html.Section(
            "What the errata change: gain k3",
            _beside([figures["errata-gain"], _law_table(errata) + _gain_table(errata.gains)]),
        ),
        html.Section(
            "What the errata change: heights and cells", _beside([figures["errata-height"], figures["errata-anchor"]])
        ),
        html.Section(
            "What the errata change: path and turns", _beside([figures["errata-path"], figures["errata-turn"]])
        ),
        html.Section(
            "Improved VFH as printed, and robust",
            _beside([figures["errata-avoider"], figures["errata-range"]])
            + _beside([_tally_table(made.readings.tallies), _alone_table(made.readings)]),
        ),
        html.Section("Robot parameters partially unknown", _calibration_part(made, figures)),
        html.Section("Checked against a study made beforehand", _beside([_way_table(errata), _hit_table(errata)])),
    ]


def _pixel_table(errata: Errata) -> str:
    rows = []
    groups = (("order", errata.orders), ("Fig. 7", (errata.union,)), ("pitched laser", errata.geometries))
    for what, variants in groups:
        for variant in variants:
            assert variant.drive.map is not None
            counts = {count.name: count.value for count in variant.drive.map.counts}
            numbers = (f"{counts[name]:,}" for name in ("kept", "floor", "too_high", "below_floor"))
            rows.append((f"{what}: {variant.name}", *numbers, length_of(variant.drive)))
    return html.table(
        ("reading", "kept", "floor", "too high", "below the floor", "plan"),
        rows,
        "Pixels of the sweep without noise by what the mapper made of them, and the plan",
        text=(0, 5),
    )


def _grid_table(errata: Errata) -> str:
    rows = [(variant.name, length_of(variant.drive)) for variant in errata.grids]
    return html.table(("cells, rule, growth", "plan"), rows, "Plans on the map without noise", text=(0, 1))


def _law_table(errata: Errata) -> str:
    rows = [(law.law.name, _seconds(law.settled), _seconds(law.law.stated)) for law in errata.laws]
    caption = f"Last time at which the position error was {_cm(BAND)} cm or more; expected by a study made beforehand"
    return html.table(("law", "ours, s", "expected, s"), rows, caption)


def _seconds(value: float | None) -> str:
    return "more than 60" if value is None or value > 60.0 else f"{value:.1f}"


def _gain_table(gains: Sequence[Variant]) -> str:
    rows = []
    for variant in gains:
        found = variant.drive.episode.summary()
        errors = _cm(found["cross_track_rms_m"]), _cm(found["cross_track_max_m"])
        rows.append((variant.name, *errors, f"{found['sim_time_s']:.1f}", variant.drive.episode.trail.outcome))
    return html.table(
        ("k3, 1/s", "rms, cm", "most, cm", "time, s", "outcome"),
        rows,
        "Cross-track error of the drive of Fig. 10 by k3. It begins with an error of heading, which a larger k3 "
        "removes sooner, before it becomes one to the side",
        text=(4,),
    )


def _tally_table(tallies: Sequence[Tally]) -> str:
    rows = [
        (
            tally.name,
            f"{tally.believed}",
            f"{tally.reached}",
            f"{max(result.goal_error for result in tally.results):.2f}",
            f"{tally.touched}",
            f"{tally.median('clearance'):.2f}",
            f"{tally.median('time'):.1f}",
        )
        for tally in tallies
    ]
    return html.table(
        ("avoider", "says it reached D", "truly did", "farthest from D, m", "touched", "clearance, m", "time, s"),
        rows,
        "Twenty seeds; clearance and time are medians",
    )


def _alone_table(readings: DriveReadings) -> str:
    rows = []
    for variant in readings.alone:
        found = variant.drive.episode.summary()
        where = "reached D" if found["truly_reached"] else f"{found['goal_error_m']:.2f} m from D"
        rows.append((variant.name, where, f"{found['min_clearance_m']:.2f}", f"{found['sim_time_s']:.1f}"))
    return html.table(
        ("key as printed", "end", "clearance, m", "time, s"),
        rows,
        "Robust, with one key as printed at a time",
        text=(1,),
    )


def _calibration_part(made: Reproduction, figures: dict[str, str]) -> str:
    if not made.calibrations:
        return html.paragraph(
            "Not run. `navloom paper --campaigns` drives 720 times with wheel radius and half track wrong by 1 to 10 "
            "%, in some minutes."
        )
    rows = [
        (
            entry.parameter,
            f"{100.0 * entry.error:+g}",
            "right" if entry.knows else "wrong",
            f"{entry.tally.believed}",
            f"{entry.tally.reached}",
            f"{entry.tally.median('goal_error'):.2f}",
            f"{max(result.goal_error for result in entry.tally.results):.2f}",
            f"{entry.tally.touched}",
        )
        for entry in made.calibrations
    ]
    names = (
        "parameter",
        "error, %",
        "odometry",
        "says it reached D",
        "truly did",
        "median from D, m",
        "most, m",
        "touched",
    )
    table = html.table(names, rows, "Twenty seeds a row, without O", text=(2,))
    return _beside([figures["errata-calibration"], table])


def _way_table(errata: Errata) -> str:
    variants = (*errata.ways, errata.orders[1])
    rows = [(variant.name, variant.stated, length_of(variant.drive)) for variant in variants]
    caption = "Plans on the map without noise, before pruning"
    return html.table(("room", "expected", "ours"), rows, caption, text=(0, 1, 2))


def _hit_table(errata: Errata) -> str:
    hits = hits_by_box(errata.quiet, errata.ways[0].drive.world)
    rows = [(name, f"{expected:,}", f"{hits[name]:,}") for name, expected in EXPECTED.items()]
    return html.table(("what a ray meets", "expected", "ours"), rows, "Of 9,494 rays of the sweep without noise")


def _provenance(made: Reproduction) -> str:
    summary = made.run.episode.summary()
    entries = [
        f"Config paper, seed {summary['seed']}, SHA-256 {summary['config_sha256']}",
        f"Trace of the run with O, SHA-256 {summary['trace_sha256']}",
        f"navloom {version('navloom')}, numpy {np.__version__}, matplotlib {version('matplotlib')}, "
        f"Python {platform.python_version()}",
        "Nothing here depends on the wall clock: the same command on one type of CPU and with one set of versions "
        "gives the same bytes.",
    ]
    return html.listing(entries) + html.code(f"navloom paper --seed {summary['seed']}")
