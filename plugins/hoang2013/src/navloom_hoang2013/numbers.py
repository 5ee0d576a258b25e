"""Table of the values that Hoang et al. 2013 state and those of our runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from navloom_hoang2013.cloud import CLASSES, Cloud, on_floor
from navloom_hoang2013.errata import Errata
from navloom_hoang2013.runs import Drive, box, crossing, gates_of

__all__ = ["NOT_STATED", "Number", "numbers_of"]

NOT_STATED = "not stated"


@dataclass(frozen=True)
class Number:
    """One row of the table.

    Attributes:
        what: Name and unit of the value.
        paper: The value as printed, or `NOT_STATED`.
        ours: The value as measured or set.
        section: Section of the paper.
        note: Why the values differ, or how ours is defined.
    """

    what: str
    paper: str
    ours: str
    section: str
    note: str = ""


def numbers_of(run: Drive, free: Drive, errata: Errata, cloud: Cloud) -> tuple[Number, ...]:
    """All rows of the table.

    Args:
        run: The experiment with the obstacle O.
        free: The experiment without it.
        errata: The variants.
        cloud: Points of the run's sweep.
    """
    return (
        *_sensing(run, errata.quiet),
        *_mapping(run, cloud),
        *_planning(run, errata),
        *_tracking(free),
        *_avoiding(run),
    )


def _sensing(run: Drive, quiet: Cloud) -> tuple[Number, ...]:
    sweep = run.sweep
    frames, beams = sweep.ranges.shape
    pitch, bearing = np.degrees(sweep.pitches), np.degrees(sweep.bearings) + 90.0
    floor = quiet.ranges[on_floor(quiet)].min()
    scan = run.choice.scan if run.choice is not None else None
    rows = [
        Number("frames of a sweep", "94", f"{frames}", "II.A"),
        Number("pitch, °", "-5 to +20", f"{pitch[0]:.2f} to {pitch[-1]:.2f}", "II.A",
               "94 frames in steps of 0.266° end at 19.74°"),
        Number("pitch step, °", "0.266", f"{np.diff(pitch).mean():.3f}", "II.A"),
        Number("bearings β, °", "40 to 140", f"{bearing[0]:.0f} to {bearing[-1]:.0f}", "II.A", f"{beams} beams at 1°"),
        Number("pixels of the 3D image", "9,494", f"{frames * beams:,}", "II.A"),
        Number("time of a sweep, s", NOT_STATED, f"{sweep.frame_times[-1]:.2f}", "II.A", "75 frames a second"),
        Number("height of the sensor, m", "0.4", f"{sweep.z:g}", "II.A"),
        Number("nearest floor that is seen, m", "4.58", f"{math.hypot(floor, sweep.z):.3f} slant, {floor:.3f} level",
               "II.A", "0.4 / sin 5° is the slant range, 0.4 / tan 5° the level one"),
    ]  # fmt: skip
    if scan is not None:
        rows += [
            Number("sonars", "8", f"{len(scan.ranges)}", "II.A", "layout not stated: ours is a P3-DX front ring"),
            Number("range of the sonars, m", "0.3 to 4", f"{scan.range_min:g} to {scan.range_max:g}", "I"),
        ]  # fmt: skip
    return tuple(rows)


def _mapping(run: Drive, cloud: Cloud) -> tuple[Number, ...]:
    counts, columns = cloud.counts, cloud.classes.shape[1]
    pressed = cloud.classes.size - counts[CLASSES[0]]
    system = run.episode.system
    return (
        Number("robot's height z_limit, m", "1.2", f"{system.robot.height:g}", "IV.A"),
        Number("start S, m", "(0, 0)", f"({system.start.x:g}, {system.start.y:g})", "IV.A"),
        Number("destination D, m", "(0, 7.6)", _goal(run), "IV.A"),
        Number("pixels pressed for Fig. 7", "9,494", f"{pressed:,}", "IV.A",
               f"{counts['no return']:,} of 9,494 rays meet nothing within the range: there is no pixel to press"),
        Number("of these, floor", NOT_STATED, f"{counts['floor']:,}", "II.B", "step 3"),
        Number("of these, above the robot", NOT_STATED, f"{counts['overhead']:,}", "II.B", "step 3"),
        Number("bearings with an obstacle", NOT_STATED, f"{counts['kept']} of {columns}", "II.B", "step 2"),
    )  # fmt: skip


def _goal(run: Drive) -> str:
    goal = run.episode.system.goal
    assert goal is not None
    return f"({goal.x:g}, {goal.y:g})"


def _planning(run: Drive, errata: Errata) -> tuple[Number, ...]:
    assert run.path is not None and run.path.traversable is not None
    corridor = errata.ways[2].drive.path
    size = 100.0 * float(np.ptp(run.episode.system.robot.footprint, axis=0).max())
    cell = 100.0 * run.path.traversable.resolution
    optimal = run.episode.summary()["optimal_length_m"]
    widths = ", ".join(f"{gate.name} {gate.right - gate.left:.1f}" for gate in gates_of(run.world))
    rows = [
        Number("robot, cm", "80 × 80", f"{size:.0f} × {size:.0f}", "IV.B"),
        Number("cell, cm", "40 × 40", f"{cell:.0f} × {cell:.0f}", "IV.B",
               f"III.A says a third of the chassis, {size / 3.0:.1f} cm: both are run below"),
        Number("growth of occupied cells", "2 cells", f"{_params(run, 'planner').dilation_cells} cells", "III.A"),
        Number("width of the gates, m", NOT_STATED, widths, "IV.A", "ours: the figures are lost; below 2.4 m the way "
               "found depends on where the grid begins"),
        Number("gate taken", "B", crossing(run.path, run.world), "IV.B"),
        Number("length of the plan, m", NOT_STATED, f"{run.path.length:.2f}", "IV.B", "of the cells, before pruning"),
        Number("shortest possible, m", NOT_STATED, f"{optimal:.2f}", "IV.B", "of the inscribed disc in the true room"),
    ]  # fmt: skip
    if corridor is not None:
        rows.append(
            Number("way through corridor C, m", "long", f"{corridor.length:.2f}", "IV.B", "with gate B blocked")
        )
    return tuple(rows)


def _tracking(free: Drive) -> tuple[Number, ...]:
    recorder, params = free.episode.recorder, _params(free, "controller")
    summary = free.episode.summary()
    truth = np.array(recorder.truth)
    driving = truth[truth[:, 4] > 0.0, 4]
    off = np.abs(np.array(recorder.cross_tracks))
    late = off[len(off) // 2 :]
    return (
        Number("reference speed, m/s", "0.2 to 0.4",
               f"{min(recorder.speeds):.2f} to {max(recorder.speeds):.2f}", "IV.C"),
        Number("real speed, m/s", "0.2 to 0.4", f"{np.median(driving):.2f} median, {driving.max():.2f} most", "IV.C",
               "it stands at first and starts with 0.5 m/s²; above the reference where it catches up"),
        Number("k1, k3, 1/s", NOT_STATED, f"{params.k1:g}, {params.k3:g}", "III.B",
               "k3 = 2 v_r is critical: 0.6 at 0.3 m/s"),
        Number("cross-track error, cm", "the real curve \"sticks to\" the designed",
               f"{100.0 * summary['cross_track_rms_m']:.1f} rms, {100.0 * off.max():.1f} most, "
               f"{100.0 * late.max():.1f} most in the second half", "IV.C",
               "it begins 28° off the first leg, facing D"),
        Number("time from S to D, s", NOT_STATED, f"{summary['sim_time_s']:.1f}", "IV.C", "with the sweep"),
    )  # fmt: skip


def _avoiding(run: Drive) -> tuple[Number, ...]:
    params, recorder, summary = _params(run, "avoider"), run.episode.recorder, run.episode.summary()
    ended = _words(run.episode.trail.outcome)
    commands = np.array(recorder.commands)
    since, until = _engaged(recorder.engaged)
    obstacle = box(run.world, "obstacle O")
    x, y = obstacle.centre
    return (
        Number("obstacle O, m", NOT_STATED, f"{np.ptp(obstacle.x):.1f} × {np.ptp(obstacle.y):.1f} × "
               f"{obstacle.z[1]:g} at ({x:g}, {y:g})", "IV.D", "on the designed trajectory, below the laser's view"),
        Number("directions that count", "within 100°", f"within {params.slot_window_deg:g}°", "III.C"),
        Number("ω, per θd - θ, 1/s", "10", f"{params.turn_gain:g}", "III.C"),
        Number("most ω, °/s", "25", f"{math.degrees(np.abs(commands[:, 2]).max()):.1f}", "III.C", "commanded"),
        Number("V_max, m/s", "0.5", f"{params.max_speed:g}; {commands[:, 1].max():.2f} most commanded", "III.C"),
        Number("V near an obstacle, m/s", "5 (d30 - 0.4)",
               f"{params.speed_gain:g} (d30 - {params.standoff:g})", "III.C",
               "clipped to 0..V_max; d30 from the robot's front, for 0.4 m from its centre is contact"),
        Number("V while turning", "V / 2.5 from 10°/s on",
               f"V / {params.slow_factor:g} from {params.slow_on_deg:g}°/s on", "III.C",
               f"until {params.slow_off_deg:g}°/s, so that it does not flicker"),
        Number("Improved VFH drives, s", NOT_STATED, f"{since:.2f} to {until:.2f}", "IV.D"),
        Number("outcome", "arrives at D", f"{ended}, {summary['collisions']} contacts", "IV.D"),
        Number("least clearance, m", NOT_STATED, f"{summary['min_clearance_m']:.2f}", "IV.D"),
        Number("way driven, m", NOT_STATED, f"{summary['path_length_m']:.2f}", "IV.D"),
        Number("time from S to D, s", NOT_STATED, f"{summary['sim_time_s']:.1f}", "IV.D", "with sweep and detour"),
    )  # fmt: skip


def _engaged(changes: list[tuple[float, bool]]) -> tuple[float, float]:
    """Start and end of the avoider's first active period, s; NaN if there is none."""
    since = next((time for time, engaged in changes if engaged), math.nan)
    until = next((time for time, engaged in changes if not engaged and time > since), math.nan)
    return since, until


def _words(outcome: str) -> str:
    return "arrives at D" if outcome == "succeeded" else outcome.replace("_", " ")


def _params(run: Drive, role: str) -> Any:
    """Parameters of the active plugin of a role."""
    system = run.episode.system
    return system.parts[(role, system.config.role_table(role).instance)].params
