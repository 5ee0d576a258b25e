"""The figures of the reproduction of Hoang et al. 2013 with their captions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from navloom_hoang2013.cloud import Cloud
from navloom_hoang2013.drive_readings import DriveReadings
from navloom_hoang2013.drives import avoiding_figure, choice_figure, tracking_figure
from navloom_hoang2013.errata import Errata, length_of, limits_of, off_the_walls
from navloom_hoang2013.errata_figures import (
    anchor_figure,
    gain_figure,
    geometry_figure,
    grid_rules_figure,
    height_figure,
    order_figure,
)
from navloom_hoang2013.figures import cloud_figure, grid_figure, map_figure, union_figure
from navloom_hoang2013.law import BESIDE, SPEED
from navloom_hoang2013.reading_figures import (
    avoiders_figure,
    calibration_figure,
    range_figure,
    shapes_figure,
    turns_figure,
)
from navloom_hoang2013.runs import Drive
from navloom_hoang2013.seeds import Calibration
from navloom_hoang2013.strips import speeds_figure, strip_figure

__all__ = ["Plate", "Reproduction", "plates_of"]


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Everything that was run.

    Attributes:
        run: The experiment with the obstacle O.
        free: The experiment without it.
        cloud: Points of the run's sweep, with the mapper's limits and geometry.
        errata: Readings of mapping, planning and gains.
        readings: Readings of the whole drive.
        calibrations: Drives with wrong robot parameters; empty if they were not asked for.
    """

    run: Drive
    free: Drive
    cloud: Cloud
    errata: Errata
    readings: DriveReadings
    calibrations: tuple[Calibration, ...]


@dataclass(frozen=True)
class Plate:
    """One figure.

    Attributes:
        stem: Stem of its file names.
        title: Title, in bold before the caption.
        caption: What the figure shows, and how it differs from the paper's.
        draw: Function that draws it.
    """

    stem: str
    title: str
    caption: str
    draw: Callable[[], Figure]


def plates_of(made: Reproduction) -> tuple[Plate, ...]:
    """All figures, in the order of the page."""
    return (
        *_map_plates(made),
        *_drive_plates(made),
        *_errata_plates(made.errata),
        *_reading_plates(made.readings),
        *_calibration_plates(made.calibrations),
    )


def _map_plates(made: Reproduction) -> tuple[Plate, ...]:
    run, cloud, counts = made.run, made.cloud, made.cloud.counts
    z_limit = limits_of(run)[1]
    assert run.path is not None
    return (
        Plate("figure-06", "Fig. 6, the 3D image.",
              f"{cloud.classes.size - counts['no return']:,} pixels of {cloud.classes.size:,} rays from S. Gate A is "
              f"under a girder lower than the robot ({z_limit:g} m), gate B under a higher one, corridor C is open. "
              "Grey edges: the true room without its ceiling; its sizes are ours, since the paper's figures are lost.",
              lambda: cloud_figure(run, cloud, z_limit)),
        Plate("figure-07", "Fig. 7, the union map.",
              f"All {cloud.classes.size - counts['no return']:,} pixels pressed onto the plane (step 1). Floor, "
              "ceiling and both girders stand in it like walls; the plan on it: "
              f"{length_of(made.errata.union.drive)}.",
              lambda: union_figure(run, cloud, z_limit)),
        Plate("figure-08", "Fig. 8, the IPaBD map.",
              f"The nearest obstacle pixel of each of {counts['kept']} bearings, and the lines fitted to them. "
              "Girder A is in it, girder B (dotted) is not. Floor and overhead pixels were removed before the "
              "minimum was taken; the printed order is shown below.",
              lambda: map_figure(run, cloud)),
        Plate("figure-09", "Fig. 9, the planned way.",
              f"Cells of 40 cm, grown by two. A* (8 neighbours, no corner cut) finds {run.path.length:.2f} m through "
              "gate B: A is closed by its girder, C is longer. What was not seen counts as free. The framework "
              "prunes and rounds the way before it is driven.",
              lambda: grid_figure(run)),
    )  # fmt: skip


def _drive_plates(made: Reproduction) -> tuple[Plate, ...]:
    run, free = made.run, made.free
    summary = free.episode.summary()
    plates = [
        Plate("figure-10", "Fig. 10, tracking.",
              "Law (6) without an obstacle: the real trajectory on the designed one, the errors of eq. (4), and the "
              f"speed. Cross-track {100.0 * summary['cross_track_rms_m']:.1f} cm rms, "
              f"{100.0 * summary['cross_track_max_m']:.1f} cm at most, where the robot, which begins facing D, "
              "swings onto the first leg. The reference is re-projected onto the path in each tick. The paper "
              "prints no errors.",
              lambda: tracking_figure(free)),
        Plate("figure-10-speeds", "Speeds as they occur.",
              "The paper says around 0.2 to 0.4 m/s. The reference stays within; the robot starts from standstill with "
              "0.5 m/s². Improved VFH drives up to 0.5 m/s, and slower where it turns.",
              lambda: speeds_figure(free, run)),
        Plate("figure-11a", "Fig. 11, the unexpected obstacle.",
              "O appears on the designed trajectory when the sweep has ended, and only the sonars see it. Improved "
              "VFH takes over when the corridor ahead is blocked, and gives back when it is free again. Where O "
              "stood in the paper's experiment is not stated.",
              lambda: avoiding_figure(run)),
    ]  # fmt: skip
    if run.choice is not None:
        choice = run.choice
        chosen = choice.diagnostics.chosen
        assert chosen is not None
        off = math.degrees(math.remainder(chosen - choice.to_target, math.tau))
        plates.append(
            Plate("figure-11b", "Fig. 11, the moment of decision,",
                  f"{choice.time:.2f} s: for the first time the direction to the target is blocked, and the chosen "
                  f"one is {abs(off):.0f}° to the {'left' if off > 0.0 else 'right'} of it. Above: the sonars, the "
                  "certainty window, and the polar histogram as a ring, dark where it is blocked. Below: the same "
                  f"histogram from the heading. {_width_words(run)}",
                  lambda: choice_figure(run))
        )  # fmt: skip
    plates.append(
        Plate("figure-12", "Fig. 12, the drive.",
              "Eight moments from start to end, evenly spaced, in place of the paper's images. O (black) appears once "
              "the sweep has ended.",
              lambda: strip_figure(run))
    )  # fmt: skip
    return tuple(plates)


def _width_words(run: Drive) -> str:
    """What makes the blocked part of the histogram wider than O."""
    system = run.episode.system
    params = system.parts[("avoider", system.config.avoider.instance)].params
    if params.enlargement == "none":
        return (
            f"Smoothing over {params.smoothing} sectors to each side makes it wider than O; the robot is a point in it."
        )
    return "The robot's width is in it, so that it is wider than O."


def _errata_plates(errata: Errata) -> tuple[Plate, ...]:
    z_limit = limits_of(errata.geometries[0].drive)[1]
    kept = [off_the_walls(cloud.of("kept"), errata.ways[0].drive.world) for cloud in errata.clouds]
    columns = [variant.drive.map for variant in errata.orders]
    assert columns[1] is not None
    return (
        Plate("errata-order", "Order of the filters.",
              "Steps 2 and 3 as printed take the nearest pixel of a bearing and then remove it where it is floor or "
              f"too high: {len(columns[1].segments)} lines are left (b), and A* goes straight through girder A. "
              "Removing first (a) keeps every bearing.",
              lambda: order_figure(errata)),
        Plate("errata-geometry", "Geometry.",
              "The pixels of one sweep without noise that truly are on the floor and on the girders, whose true "
              "heights are shaded. A laser that is pitched as a whole measures (a); eq. (1) is a pan-tilt model and "
              "overstates heights 1/sinβ times, 1.56 times at β = 40° (b). An obstacle 1.0 m high counts as higher "
              "than the robot from 41° off the middle on. In this room the plan is "
              f"{length_of(errata.geometries[0].drive)}, and {length_of(errata.geometries[1].drive)}; what is "
              f"kept lies {100.0 * kept[1].mean():.1f} cm off the true walls on average and "
              f"{100.0 * kept[1].max():.1f} cm at most. The experiment above uses eq. (1) for simulator and "
              "mapper alike.",
              lambda: geometry_figure(errata, z_limit)),
        Plate("errata-grid", "Cells and their drawing.",
              "40 cm as in the experiment (a), a third of the chassis as in III.A (b), and the printed slope test, "
              "with T the size of the robot and grown as printed (c), and not grown (d). The test compares a slope "
              "with a length and does not end where the line does: it fills whole columns, and leaves girder A open.",
              lambda: grid_rules_figure(errata)),
        Plate("errata-height", "z = 0.",
              "Step 3 removes z = 0, \"corresponding to the floor\". z of eq. (1) is 0 at the sensor, and the floor "
              "is at z = -0.4 m. As printed (b), the floor stays and is the nearest obstacle of every bearing, an arc "
              f"4.57 m ahead: {length_of(errata.heights[1].drive)}. Counted from the floor (a): "
              f"{length_of(errata.heights[0].drive)}.",
              lambda: height_figure(errata)),
        Plate("errata-anchor", "Where the cells begin.",
              "Cells with centres at S plus multiples of 40 cm (a), and counted from the lowest x and y of the "
              "outlines as printed (b), both grown by two cells (grey; blue: outlines). S and D then lie beside the "
              "centres of their cells, "
              f"and the plan is {length_of(errata.anchors[1].drive)} instead of {length_of(errata.anchors[0].drive)}.",
              lambda: anchor_figure(errata)),
        Plate("errata-gain", "Gain k3.",
              f"Law (6) from {BESIDE:g} m beside a line at {SPEED:g} m/s, k1 = 1, nothing limited. The lateral poles "
              f"are s² + k3 s + v_r²: critical at k3 = 0.6, slower above. The other laws settle {_faster(errata)} "
              "times as fast as the best k3.",
              lambda: gain_figure(errata)),
    )  # fmt: skip


def _reading_plates(readings: DriveReadings) -> tuple[Plate, ...]:
    printed, robust = readings.tallies
    wide = readings.ranges[2].passes.episode.summary()
    return (
        Plate("errata-path", "From cells to a trajectory.",
              "The paper does not say how the path of A* becomes q_r(t). Pruned and rounded (a); along the cells (b), "
              "where θr jumps by 45° at corners and ωr stays 0: law (6) swings onto each leg, and where the robot "
              "misses D so, the goal node plans again. The figure shows the first plan.",
              lambda: shapes_figure(readings)),
        Plate("errata-turn", "Turning in place.",
              "Starts off the heading of the first leg, noise-free, in an empty world. Law (6) alone drives off the "
              "line, and backwards where e3 exceeds 90°: from 135° on, the command gate does not let it reverse into "
              "what no sensor sees. With a turn in place first, every start arrives.",
              lambda: turns_figure(readings)),
        Plate("errata-avoider", "Improved VFH as printed, and robust.",
              "Above: tracks of 20 seeds round O, red where the avoider drives in the run shown. Middle: the histogram "
              "where it first turns away (green: to the target, red: chosen; dotted: threshold). Below: distance to "
              f"the nearest obstacle. As printed, {printed.reached} of 20 truly reach D with "
              f"{printed.median('clearance'):.2f} m of clearance (median) and {printed.touched} touch; robust, "
              f"{robust.reached} with {robust.median('clearance'):.2f} m and {robust.touched}.",
              lambda: avoiders_figure(readings)),
        Plate("errata-range", "From 0.3 to 4 m.",
              "A straight drive at O without avoidance. The avoider acts where the density (solid) exceeds its "
              "threshold (dotted), from the dashed line on. The sonars hear O from 4 m on; VFH's window of 33 cells of "
              "0.1 m ends 1.6 m to the sides. With 81 cells the experiment ends "
              f"{wide['goal_error_m']:.2f} m from D, with {wide['collisions']} contacts.",
              lambda: range_figure(readings)),
    )  # fmt: skip


def _calibration_plates(calibrations: tuple[Calibration, ...]) -> tuple[Plate, ...]:
    if not calibrations:
        return ()
    return (
        Plate("errata-calibration", "Robot parameters partially unknown.",
              "Drives without O, 20 seeds a point, with a wheel radius or half track that differs from the one that "
              "the robot assumes. Where odometry knows the true value (dotted), law (6) does not notice. Where "
              "odometry is wrong as well (solid), the robot follows a wrong estimate, which no feedback corrects. "
              "Dashed: what "
              "counts as reached, 0.3 m.",
              lambda: calibration_figure(calibrations)),
    )  # fmt: skip


def _faster(errata: Errata) -> str:
    """Range of the factors by which the other laws settle faster than law (6) with its best k3, as text."""
    settled = [(law.law.plugin, law.settled) for law in errata.laws if law.settled is not None]
    own = min(seconds for plugin, seconds in settled if plugin == "lyapunov_tracker")
    others = sorted(own / seconds for plugin, seconds in settled if plugin != "lyapunov_tracker")
    return f"{others[0]:.0f} to {others[-1]:.0f}"
