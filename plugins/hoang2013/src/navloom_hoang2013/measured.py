"""What our runs gave for each statement of Hoang et al. 2013."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from navloom.geometry.world import Box
from numpy.typing import NDArray

from navloom_hoang2013.cloud import CLASSES, Cloud, on_floor, rays_towards
from navloom_hoang2013.errata import length_of
from navloom_hoang2013.plates import Reproduction
from navloom_hoang2013.runs import START, Drive, box, crossing, gates_of, moving_speeds
from navloom_hoang2013.statements import Finding, Statement, judged

__all__ = ["findings_of", "statements_of"]

Floats = NDArray[np.float64]
NOT_RUN = "not run: `navloom paper --campaigns`"


def statements_of(made: Reproduction) -> tuple[Statement, ...]:
    """All statements with what our runs gave."""
    return judged(findings_of(made), made.run.episode.system)


def findings_of(made: Reproduction) -> dict[str, Finding]:
    """What the runs gave, by the id of the statement."""
    return {
        **_introduction(made),
        **_collecting(made),
        **_mapping(made),
        **_grid(made),
        **_planning(made),
        **_control(made),
        **_avoider(made),
        **_world(made),
        **_drives(made),
        **_conclusion(made),
    }


def _params(run: Drive, role: str) -> Any:
    """Parameters of the active plugin of a role."""
    system = run.episode.system
    return system.parts[(role, system.config.role_table(role).instance)].params


def _introduction(made: Reproduction) -> dict[str, Finding]:
    counts, columns = made.cloud.counts, made.cloud.classes.shape[1]
    ranges = "; ".join(
        f"{reach.name}: " + ("never" if reach.acts_from is None else f"from {reach.acts_from:.2f} m")
        for reach in made.readings.ranges
    )
    passed = {
        method: [f"{door.width:g}" for door in made.readings.doors if door.method == method and door.passed]
        for method in dict.fromkeys(door.method for door in made.readings.doors)
    }
    doors = "; ".join(f"{method}: doors of {', '.join(widths) or 'no'} m" for method, widths in passed.items())
    blocked = set(passed["virtual forces"]) < set(passed["Improved VFH"])
    active = made.readings.range_of(made.run)
    return {
        "I-1": Finding(f"{counts['kept']} pixels for {columns} bearings", counts["kept"] == columns),
        "I-2": Finding(ranges + ", of the robot's centre from O", active is not None and active >= 4.0),
        "I-3": Finding(doors, blocked),
    }


def _collecting(made: Reproduction) -> dict[str, Finding]:
    sweep, quiet = made.run.sweep, made.errata.quiet
    frames, beams = sweep.ranges.shape
    pitch, bearing = np.degrees(sweep.pitches), np.degrees(sweep.bearings) + 90.0
    steps, times = np.diff(pitch), np.diff(sweep.frame_times)
    pixels = int(np.isfinite(sweep.ranges).sum())
    floor = float(quiet.ranges[on_floor(quiet)].min())
    slant = math.hypot(floor, sweep.z)
    scan = made.run.choice.scan if made.run.choice is not None else None
    sonars = 0 if scan is None else len(scan.ranges)
    heard = "" if scan is None else f", from {scan.range_min:g} to {scan.range_max:g} m"
    obstacle = box(made.run.world, "obstacle O")
    would, did = rays_towards(sweep, START, obstacle), _pixels_on(made.cloud, obstacle)
    grows = 1.0 / math.cos(sweep.pitches[-1]) ** 2
    return {
        "II.A-1": Finding(f"{frames}", frames == 94),
        "II.A-2": Finding(f"{pitch[0]:.2f}° to {pitch[-1]:.2f}°"),
        "II.A-3": Finding(f"{steps.mean():.3f}°", bool(np.allclose(steps, 0.266))),
        "II.A-4": Finding(f"{bearing[0]:.0f}° to {bearing[-1]:.0f}°, {beams} beams at {np.diff(bearing).mean():.0f}°",
                          beams == 101 and bool(np.allclose(bearing, np.arange(40.0, 141.0)))),
        "II.A-5": Finding(f"{pixels:,} of {frames * beams:,} rays return", pixels == 9494),
        "II.A-6": Finding(f"{steps.mean():.3f}° every {1e3 * times.mean():.1f} ms; the steps of the height on a wall "
                          f"grow {grows:.2f} times", grows < 1.01),
        "II.A-7": Finding(f"{sweep.z:g} m", sweep.z == 0.4),
        "II.A-8": Finding(f"{slant:.3f} m slant, {floor:.3f} m level", abs(slant - 4.58) < 0.01),
        "II.A-9": Finding(f"{sonars}{heard}", sonars == 8),
        "II.A-10": Finding(f"{would} rays would meet O, {did} did; the sonars hear it", made.run.choice is not None),
    }  # fmt: skip


def _pixels_on(cloud: Cloud, box: Box, noise: float = 0.05) -> int:
    """Number of pixels within `noise`, m, of a box."""
    points = cloud.points.reshape(-1, 3)
    low, high = np.array([box.x, box.y, box.z]).T
    # NaN where a ray has returned nothing.
    with np.errstate(invalid="ignore"):
        return int(((points >= low - noise) & (points <= high + noise)).all(axis=1).sum())


def _mapping(made: Reproduction) -> dict[str, Finding]:
    cloud, counts, errata = made.cloud, made.cloud.counts, made.errata
    pixels = cloud.classes.size - counts[CLASSES[0]]
    several = int((np.isfinite(made.run.sweep.ranges).sum(axis=0) > 1).sum())
    columns = cloud.classes.shape[1]
    union, first, printed = errata.union.drive, errata.orders[0].drive, errata.orders[1].drive
    assert union.map is not None and printed.map is not None and made.run.map is not None
    kept = {count.name: count.value for count in union.map.counts}["kept"]
    floor, sensor = (variant.drive for variant in errata.heights)
    away = 100.0 * errata.away.max()
    limit = _params(made.run, "mapper").segmentation
    objects = len(made.run.map.segments)
    return {
        "II.B-1": Finding(f"eq. (1) on both; a laser pitched as a whole, read by eq. (1), is up to {away:.1f} cm off"),
        "II.B-2": Finding(f"{kept:,} of {pixels:,} pixels; plan on them: {length_of(union)}", kept == pixels),
        "II.B-3": Finding(f"{several} of {columns} bearings have several", several == columns),
        "II.B-4": Finding(f"the least R cosα of {counts['kept']} of {columns} bearings", holds=False),
        "II.B-5": Finding(
            f"printed: {len(printed.map.segments)} lines, {length_of(printed)}; ours: {length_of(first)}"
        ),
        "II.B-6": Finding(f"{made.run.episode.system.robot.height:g} m; {counts['overhead']:,} pixels removed"),
        "II.B-7": Finding(
            f"printed: {length_of(sensor)}; ours: {length_of(floor)}, {counts['floor']:,} pixels of floor"
        ),
        "II.B-8": Finding(f"{limit}"),
        "III.A-1": Finding(f"{objects} lines", objects > 0),
    }


def _grid(made: Reproduction) -> dict[str, Finding]:
    plans = {variant.name: length_of(variant.drive) for variant in made.errata.grids}
    start, lowest = (variant.drive for variant in made.errata.anchors)
    dilation = _params(made.run, "planner").dilation_cells
    rule = "the printed test"
    return {
        "III.A-2": Finding(f"printed: {plans['0.267 m, distance to the line, grown by 2 cells']}; ours: "
                           f"{plans['0.40 m, distance to the line, grown by 2 cells']}"),
        "III.A-3": Finding("occupied is 1"),
        "III.A-4": Finding(f"{dilation} cells; {made.run.episode.recorder.touches} contacts",
                           dilation == 2 and made.run.episode.recorder.touches == 0),
        "III.A-5": Finding(f"printed: {length_of(lowest)}; ours: {length_of(start)}"),
        "III.A-6": Finding(f"printed: {plans[f'0.40 m, {rule}, grown by 2 cells']}"),
        "III.A-7": Finding(f"printed, not grown: {plans[f'0.40 m, {rule}, not grown']}"),
    }  # fmt: skip


def _planning(made: Reproduction) -> dict[str, Finding]:
    rounded, planned = (variant.drive.episode.summary() for variant in made.readings.shapes)
    assert made.run.path is not None
    optimal = made.run.episode.summary()["optimal_length_m"]
    plans = [len(variant.drive.episode.recorder.plans) for variant in made.readings.shapes]
    return {
        "III.A-8": Finding(f"{made.run.path.length:.2f} m on the grid; {optimal:.2f} m for a disc in the true room"),
        "III.A-9": Finding(f"cells: {_cm(planned)} off at most, {planned['sim_time_s']:.1f} s, {plans[1]} plans; "
                           f"rounded: {_cm(rounded)}, {rounded['sim_time_s']:.1f} s, {plans[0]} plan"),
    }  # fmt: skip


def _cm(summary: dict[str, Any]) -> str:
    return f"{100.0 * summary['cross_track_max_m']:.1f} cm"


def _control(made: Reproduction) -> dict[str, Finding]:
    speeds = made.free.episode.recorder.speeds
    params, robot = _params(made.free, "controller"), made.run.episode.system.robot
    settled = {law.law.params.get("k3"): law.settled for law in made.errata.laws}
    away = [turn for turn in made.readings.turns if turn.off == 135]
    ends = ", ".join(f"{turn.above}°: {_outcome(turn.drive)}" for turn in away)
    e3 = np.abs(made.free.errors[:, 3])
    return {
        "III.B-1": Finding(f"r = {robot.wheel_radius:g} m, R = {robot.half_track:g} m"),
        "III.B-2": Finding(calibration_words(made)),
        "III.B-3": Finding(f"least v_r {min(speeds):.2f} m/s", min(speeds) > 0.0),
        "III.B-4": Finding(f"{len(made.free.errors)} ticks; |e3| at most {math.degrees(e3.max()):.0f}°"),
        "III.B-5": Finding("to 1e-6 (test)"),
        "III.B-6": Finding(f"start 135° off, turn in place above {ends}"),
        "III.B-7": Finding(f"|ω| at most {_turning(made.free):.1f}°/s commanded"),
        "III.B-8": Finding(f"k1 = {params.k1:g}, k3 = {params.k3:g}"),
        "III.B-9": Finding("to 1e-6 along the closed loop (test)"),
        "III.B-10": Finding(f"k3 = 0.6 settles in {settled[0.6]:.1f} s, k3 = 2 in {settled[2.0]:.1f} s"),
    }


def _turning(run: Drive) -> float:
    """Largest commanded turn rate, °/s."""
    return math.degrees(float(np.abs(np.array(run.episode.recorder.commands)[:, 2]).max()))


def _outcome(run: Drive) -> str:
    summary = run.episode.summary()
    return f"arrives in {summary['sim_time_s']:.1f} s" if summary["truly_reached"] else f"{summary['outcome']}"


def calibration_words(made: Reproduction) -> str:
    """How often the robot reached D with wheels 5 % off, in one sentence."""
    found = [entry for entry in made.calibrations if abs(entry.error) == 0.05]
    if not found:
        return NOT_RUN
    shares = []
    for knows, words in ((False, "odometry wrong as well"), (True, "odometry right")):
        tallies = [entry.tally for entry in found if entry.knows == knows]
        total = sum(len(tally.results) for tally in tallies)
        shares.append(f"{sum(tally.reached for tally in tallies)} of {total} truly reach D with {words}")
    return "wheel radius or track ±5 %: " + ", ".join(shares)


def _avoider(made: Reproduction) -> dict[str, Finding]:
    params, choice = _params(made.run, "avoider"), made.run.choice
    values = "none" if choice is None else ", ".join(str(v) for v in np.unique(choice.diagnostics.window) if v)
    sectors = 0 if choice is None else len(choice.diagnostics.histogram)
    commands = np.array(made.run.episode.recorder.commands)
    turning = _turning(made.run)
    return {
        "III.C-1": Finding(f"values {values} in the window", set(values.split(", ")) <= {"2", "3"}),
        "III.C-2": Finding(f"reset of the {params.reset_scope}"),
        "III.C-3": Finding(f"{sectors} sectors; " + ("sum, smoothed" if params.enlargement == "none" else "maximum, "
                           "enlarged by the robot's radius"), sectors == 72),
        "III.C-4": Finding(f"within {params.slot_window_deg:g}°"),
        "III.C-5": Finding(f"{params.rotation_deg:g}°, at most {params.attempts} times"),
        "III.C-6": Finding("left if wrap(θt - θ) > 0"),
        "III.C-7": Finding(f"{params.case_limit_deg:g}°; loyalty {params.loyalty_deg:g}°"),
        "III.C-8": Finding(f"{params.turn_gain:g} (θd - θ)"),
        "III.C-9": Finding(f"{turning:.1f}°/s at most commanded", turning <= 25.0 + 1e-6),
        "III.C-10": Finding(f"{params.max_speed:g} m/s; {commands[:, 1].max():.2f} m/s at most commanded"),
        "III.C-11": Finding(f"{params.speed_gain:g} (d30 - {params.standoff:g}), from the robot's "
                            f"{params.distance_from}"),
        "III.C-12": Finding(f"±{params.front_sector_deg:g}°"),
        "III.C-13": Finding(f"V / {params.slow_factor:g} from {params.slow_on_deg:g}°/s, until "
                            f"{params.slow_off_deg:g}°/s"),
    }  # fmt: skip


def _world(made: Reproduction) -> dict[str, Finding]:
    system, ways = made.run.episode.system, made.errata.ways
    goal, start, robot = system.goal, system.start, system.robot
    assert goal is not None and made.run.path is not None and made.run.path.traversable is not None
    low, high = box(made.run.world, "girder A").z, box(made.run.world, "girder B").z
    widths = ", ".join(f"{gate.name} {gate.right - gate.left:.1f} m" for gate in gates_of(made.run.world))
    size = 100.0 * np.ptp(robot.footprint, axis=0)
    cell = 100.0 * made.run.path.traversable.resolution
    pixels = made.cloud.classes.size - made.cloud.counts[CLASSES[0]]
    open_a, blocked_b = ways[1].drive, ways[2].drive
    gate = crossing(made.run.path, made.run.world)
    return {
        "IV.A-1": Finding(f"S ({start.x:g}, {start.y:g}), D ({goal.x:g}, {goal.y:g})"),
        "IV.A-2": Finding(f"{robot.height:g} m"),
        "IV.A-3": Finding(f"A {low[0]:g} to {low[1]:g} m, B {high[0]:g} to {high[1]:g} m; {widths}",
                          low[0] < robot.height < high[0]),
        "IV.A-4": Finding(f"with B blocked: {length_of(blocked_b)}", length_of(blocked_b).endswith("gate C")),
        "IV.A-5": Finding(f"{pixels:,}", pixels == 9494),
        "IV.A-6": Finding(f"{made.cloud.counts['kept']} bearings, girder A and not B"),
        "IV.B-1": Finding(f"{cell:.0f} × {cell:.0f} cm²", round(cell) == 40),
        "IV.B-2": Finding(f"{size[0]:.0f} × {size[1]:.0f} cm²"),
        "IV.B-3": Finding(f"without the girder: {length_of(open_a)}", gate != "A" and length_of(open_a)[-1] == "A"),
        "IV.B-4": Finding(f"with B blocked: {length_of(blocked_b)}", gate != "C"),
        "IV.B-5": Finding(length_of(made.run), gate == "B"),
    }  # fmt: skip


def _drives(made: Reproduction) -> dict[str, Finding]:
    run, free = made.run.episode.summary(), made.free.episode.summary()
    off = 100.0 * np.abs(np.array(made.free.episode.recorder.cross_tracks))
    late, speeds = off[len(off) // 2 :], moving_speeds(made.free)
    share = float(np.mean((speeds >= 0.19) & (speeds <= 0.41)))
    obstacle = box(made.run.world, "obstacle O")
    since, until = _engaged(made.run.episode.recorder.engaged)
    x, y = obstacle.centre
    return {
        "IV.C-1": Finding(f"{100.0 * free['cross_track_rms_m']:.1f} cm rms, {off.max():.1f} cm at most, "
                          f"{late.max():.1f} cm in the second half", bool(late.max() < 5.0)),
        "IV.C-2": Finding(f"{100.0 * share:.0f} % of the time in 0.19 to 0.41 m/s; median {np.median(speeds):.2f}, at "
                          f"most {speeds.max():.2f} m/s", share > 0.9),
        "IV.D-1": Finding(f"{np.ptp(obstacle.x):.1f} × {np.ptp(obstacle.y):.1f} × {obstacle.z[1]:g} m at ({x:g}, "
                          f"{y:g})"),
        "IV.D-2": Finding(f"the avoider drives from {since:.2f} to {until:.2f} s; {run['min_clearance_m']:.2f} m "
                          "clearance",
                          run["collisions"] == 0 and until < run["sim_time_s"]),
        "IV.D-3": Finding(f"with O {run['goal_error_m']:.2f} m from D after {run['sim_time_s']:.1f} s, without "
                          f"{free['goal_error_m']:.2f} m after {free['sim_time_s']:.1f} s",
                          bool(run["truly_reached"] and free["truly_reached"])),
        "IV.D-4": Finding("eight moments"),
    }  # fmt: skip


def _engaged(changes: list[tuple[float, bool]]) -> tuple[float, float]:
    """Start and end of the avoider's first active period, s; NaN if there is none."""
    since = next((time for time, engaged in changes if engaged), math.nan)
    until = next((time for time, engaged in changes if not engaged and time > since), math.nan)
    return since, until


def _conclusion(made: Reproduction) -> dict[str, Finding]:
    tallies = made.readings.tallies
    words = "; ".join(
        f"{tally.name}: {tally.touched} of {len(tally.results)} seeds touch, {tally.reached} truly reach D"
        for tally in tallies
    )
    return {
        "V-1": Finding(words, all(tally.touched == 0 for tally in tallies)),
        "V-2": Finding(calibration_words(made)),
    }
