"""Reproduction of Hoang et al. 2013: Figures 6 to 12, its statements beside ours, and what its errata change."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from navloom import NavloomError
from navloom.plugins import Discovery

from navloom_hoang2013.cloud import cloud_of
from navloom_hoang2013.drive_readings import DriveReadings, readings_of, steps_of_readings
from navloom_hoang2013.errata import Errata, Variant, errata_of, limits_of, steps_of_errata
from navloom_hoang2013.measured import statements_of
from navloom_hoang2013.plates import Plate, Reproduction, plates_of
from navloom_hoang2013.report import page_of
from navloom_hoang2013.runs import START, Drive, crossing, drive
from navloom_hoang2013.seeds import Tally, calibrations, steps_of_campaigns

__all__ = ["FIGURES", "FILES", "PaperError", "drawn", "facts_of", "files_of", "is_reproduced", "reproduce", "steps"]

FIGURES = 19
"""Number of figures that are drawn if the whole experiment ran; campaigns add one."""
FILES = ("report.html", "numbers.json", "figure-*", "errata-*")
"""Patterns of the file names that `files_of` returns."""
Say = Callable[[str], None]


class PaperError(NavloomError, RuntimeError):
    """The experiment ended too early to draw its figures."""

    exit_code = 1


def steps(campaigns: bool = False) -> int:
    """Number of calls of `say` by `reproduce` and `files_of` together."""
    more = steps_of_campaigns() + 1 if campaigns else 0
    return 2 + steps_of_errata() + steps_of_readings() + FIGURES + more


def reproduce(
    seed: int | None = None,
    say: Say = lambda text: None,
    discovery: Discovery | None = None,
    campaigns: bool = False,
) -> Reproduction:
    """Run the experiment with and without its obstacle, and both readings of each omission or error of the paper.

    Args:
        seed: Seed of the runs with noise; None: the shipped config's.
        say: Called with the name of each run before it starts.
        discovery: Source of the plugins; default: those installed.
        campaigns: Whether to drive with wrong robot parameters too: 720 drives, some minutes.

    Raises:
        ConfigError, PluginError: A plugin of the experiment is missing.
        PaperError: The robot found no path, or never drove.
    """
    discovery = discovery or Discovery()
    say("the experiment with obstacle O")
    run = _driven(drive(seed=seed))
    say("the experiment without it")
    free = _driven(drive("world.ref=paper_gates", seed=seed))
    errata = errata_of(seed, say, discovery)
    cloud = cloud_of(run.sweep, START, *limits_of(run), "paper")
    readings = readings_of(seed, say)
    return Reproduction(run, free, cloud, errata, readings, calibrations(say) if campaigns else ())


def _driven(run: Drive) -> Drive:
    """The run. Raises PaperError if it lacks what the figures need."""
    if run.path is None or run.trajectory is None or not run.episode.recorder.cross_tracks:
        result = run.episode.result
        raise PaperError(
            f"the experiment in world {run.world.name} came to nothing that can be drawn: "
            f"{result.outcome}, {result.reason}"
        )
    return run


def files_of(made: Reproduction, say: Say = lambda text: None) -> dict[str, bytes]:
    """All files by name: figures as PNG and SVG, `report.html`, `numbers.json`. Repeated calls give the same bytes."""
    files, drawings = {}, []
    for plate in plates_of(made):
        say(f"drawing {plate.stem}")
        svg, png = drawn(plate)
        drawings.append((plate, svg))
        files[f"{plate.stem}.png"] = png
        files[f"{plate.stem}.svg"] = svg.encode()
    files["report.html"] = page_of(made, drawings).encode()
    files["numbers.json"] = (json.dumps(facts_of(made), indent=2, ensure_ascii=False) + "\n").encode()
    return files


def drawn(plate: Plate) -> tuple[str, bytes]:
    """A figure as SVG and as PNG of 300 dpi."""
    from navloom_study.report import png_of, svg_of

    figure = plate.draw()
    svg = svg_of(figure)
    figure.set_layout_engine("none")  # already laid out for the SVG
    return svg, png_of(figure, 300)


def facts_of(made: Reproduction) -> dict[str, Any]:
    """Content of `navloom paper --json`, in SI units: outcomes, the table, and every variant of the errata."""
    run, free, errata = made.run.episode.summary(), made.free.episode.summary(), made.errata
    return {
        "seed": run["seed"],
        "config_sha256": run["config_sha256"],
        "trace_sha256": run["trace_sha256"],
        "reproduced": is_reproduced(made),
        "with_obstacle": _drive_facts(made.run, run),
        "without_obstacle": _drive_facts(made.free, free),
        "statements": [vars(statement) for statement in statements_of(made)],
        "errata": _errata_facts(errata),
        "drives": _reading_facts(made.readings),
        "calibrations": [
            {
                "parameter": entry.parameter,
                "error": entry.error,
                "odometry_knows": entry.knows,
                **_tally_facts(entry.tally),
            }
            for entry in made.calibrations
        ],
    }


def is_reproduced(made: Reproduction) -> bool:
    """Whether both runs truly arrived at D without contact, with a plan through gate B."""
    return all(
        run.episode.trail.succeeded
        and run.episode.recorder.touches == 0
        and run.path is not None
        and crossing(run.path, run.world) == "B"
        for run in (made.run, made.free)
    )


def _drive_facts(run: Drive, summary: Mapping[str, Any]) -> dict[str, Any]:
    names = ("outcome", "reason", "truly_reached", "goal_error_m", "sim_time_s", "plan_length_m", "path_length_m",
             "optimal_length_m", "cross_track_rms_m", "cross_track_max_m", "min_clearance_m", "collisions")  # fmt: skip
    return {"gate": _gate(run), **{name: summary[name] for name in names}}


def _gate(run: Drive) -> str | None:
    has_gates = any(obstacle.name == "partition" for obstacle in run.world.obstacles)
    return crossing(run.path, run.world) if has_gates and run.path is not None else None


def _errata_facts(errata: Errata) -> dict[str, Any]:
    def plans(variants: tuple[Variant, ...]) -> list[dict[str, Any]]:
        return [
            {
                "name": variant.name,
                "set": list(variant.settings),
                "plan_length_m": None if variant.drive.path is None else variant.drive.path.length,
                "gate": _gate(variant.drive),
                "pixels": {} if variant.drive.map is None else {c.name: c.value for c in variant.drive.map.counts},
            }
            for variant in variants
        ]

    return {
        "ways": plans(errata.ways),
        "filter_order": plans(errata.orders),
        "geometry": plans(errata.geometries),
        "grid": plans(errata.grids),
        "height_frame": plans(errata.heights),
        "anchor": plans(errata.anchors),
        "settling": [
            {"law": law.law.name, "settled_s": law.settled, "expected_s": law.law.stated} for law in errata.laws
        ],
        "k3": [{"k3": float(v.name), **_drive_facts(v.drive, v.drive.episode.summary())} for v in errata.gains],
    }


def _reading_facts(readings: DriveReadings) -> dict[str, Any]:
    def drives(variants: tuple[Variant, ...]) -> list[dict[str, Any]]:
        return [
            {"name": v.name, "set": list(v.settings), **_drive_facts(v.drive, v.drive.episode.summary())}
            for v in variants
        ]

    return {
        "path_shape": drives(readings.shapes),
        "turn_in_place": [
            {"off_deg": turn.off, "above_deg": turn.above, **_drive_facts(turn.drive, turn.drive.episode.summary())}
            for turn in readings.turns
        ],
        "avoiders": drives(readings.avoiders),
        "seeds": [{"name": tally.name, **_tally_facts(tally)} for tally in readings.tallies],
        "one_key_printed": drives(readings.alone),
        "range": [
            {"name": reach.name, "acts_from_m": reach.acts_from, "threshold": reach.threshold,
             **_drive_facts(reach.passes, reach.passes.episode.summary())}
            for reach in readings.ranges
        ],
        "doors": [{"method": door.method, "width_m": door.width, "passed": door.passed} for door in readings.doors],
    }  # fmt: skip


def _tally_facts(tally: Tally) -> dict[str, Any]:
    return {"set": list(tally.settings), "drives": [
        {name: value for name, value in vars(result).items() if name != "track"} for result in tally.results
    ]}  # fmt: skip
