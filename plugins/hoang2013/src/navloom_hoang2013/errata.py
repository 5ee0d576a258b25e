"""Omissions and errors of Hoang et al. 2013 in mapping, planning and gains: runs of the printed reading and of ours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from navloom.geometry.world import Box, World
from navloom.plugins import Discovery
from numpy.typing import NDArray

from navloom_hoang2013.cloud import Cloud, cloud_of, on_box, on_floor
from navloom_hoang2013.law import LAWS, Settling, settle
from navloom_hoang2013.runs import PLANNED, QUIET, START, Drive, box, crossing, drive

__all__ = [
    "ROOM",
    "Errata",
    "Variant",
    "errata_of",
    "grown",
    "length_of",
    "limits_of",
    "off_the_walls",
    "steps_of_errata",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
ROOM = "world.ref=paper_gates"
RIGID = "sensor.laser.geometry=rigid_pitch"
GAINS = (0.3, 0.6, 1.0, 2.0, 5.0)


@dataclass(frozen=True, eq=False)
class Variant:
    """The run of one reading.

    Attributes:
        name: Name of the reading, for people.
        settings: Differences from the config `paper`, in the form of `--set`.
        drive: The run.
        stated: Length, m, and gate found by the study made beforehand; empty if it has none.
    """

    name: str
    settings: tuple[str, ...]
    drive: Drive
    stated: str = ""


@dataclass(frozen=True, eq=False)
class Errata:
    """All variants.

    Attributes:
        ways: Plans in the worlds of the experiment, which leave different gates open.
        orders: Filters before the minimum, and in the printed order.
        quiet: Points of the sweep without noise in the room as described.
        union: Plan on the union map of Fig. 7.
        geometries: A laser pitched as a whole, with its true geometry and with eq. (1).
        clouds: The points of both.
        parts: (frames, beams) True where a pixel of both is truly on the floor, on girder A, and on girder B.
        grids: Cell sizes and raster methods, with growth and without.
        heights: Heights of the filters counted from the floor, and from the sensor as printed.
        anchors: Cells counted from S, and from the lowest x and y of the outlines as printed.
        laws: Settling of law (6) by its gain k3, and of other laws.
        gains: The whole run by k3.
    """

    ways: tuple[Variant, ...]
    orders: tuple[Variant, ...]
    quiet: Cloud
    union: Variant
    geometries: tuple[Variant, ...]
    clouds: tuple[Cloud, ...]
    parts: tuple[Bools, ...]
    grids: tuple[Variant, ...]
    heights: tuple[Variant, ...]
    anchors: tuple[Variant, ...]
    laws: tuple[Settling, ...]
    gains: tuple[Variant, ...]

    @property
    def away(self) -> Floats:
        """(n,) distance from the true walls of what is kept of a laser pitched as a whole if read by eq. (1), m."""
        return off_the_walls(self.clouds[1].of("kept"), self.ways[0].drive.world)


WAYS = (
    ("as described", "paper_gates", "10.29 m, gate B"),
    ("girder A removed", "paper_gates_open_a", "7.60 m, gate A"),
    ("gate B blocked", "paper_gates_blocked_b", "15.66 m, gate C"),
    ("B and C blocked", "paper_gates_blocked_bc", "no path"),
)
ORDERS = (
    ("filters first, then the minimum", (), "10.29 m, gate B"),
    ("as printed: the minimum first", ("mapper.filter_order=paper",), "7.60 m, gate A"),
)
GEOMETRIES = (("read as it is", ("mapper.geometry=as_sweep",)), ("read by eq. (1)", ("mapper.geometry=paper",)))
CELLS = (("0.40 m", "0.4"), ("0.267 m", "third_of_chassis"))
RASTERS = (("distance to the line", "distance"), ("every cell touched", "supercover"), ("the printed test", "paper"))
HEIGHTS = (("from the floor", "floor"), ("as printed: from the sensor", "sensor"))
ANCHORS = (("from S", "start"), ("as printed: from x_min, y_min", "lowest"))
GROWTH_NAMES = {2: "grown by 2 cells", 0: "not grown"}


def steps_of_errata() -> int:
    """Number of calls of `say` by `errata_of`."""
    return (
        1
        + len(WAYS)
        + len(ORDERS)
        + len(GEOMETRIES)
        + len(CELLS) * len(RASTERS) * len(GROWTH_NAMES)
        + len(HEIGHTS)
        + len(ANCHORS)
        + len(LAWS)
        + len(GAINS)
    )


def errata_of(seed: int | None, say: Callable[[str], None], discovery: Discovery) -> Errata:
    """Run every variant. Those that end with a plan run without noise, as in the study made beforehand.

    Args:
        seed: Seed of the runs with noise; None: the config's.
        say: Called with the name of each variant before it runs.
        discovery: Source of the controller plugins.
    """

    @cache
    def quiet(*settings: str) -> Drive:
        return drive(*settings, *QUIET, PLANNED)

    def planned(name: str, settings: tuple[str, ...], stated: str = "") -> Variant:
        say(name)
        return Variant(name, settings, quiet(*settings), stated)

    def settled() -> tuple[Settling, ...]:
        found = []
        for law in LAWS:
            say(law.name)
            found.append(settle(law, discovery))
        return tuple(found)

    def driven(k3: float) -> Variant:
        say(f"drive with k3 = {k3:g}")
        settings = (ROOM, f"controller.k3={k3:g}")
        return Variant(f"{k3:g}", settings, drive(*settings, seed=seed))

    geometries = tuple(planned(name, (ROOM, RIGID, *settings)) for name, settings in GEOMETRIES)
    run = geometries[0].drive
    true = cloud_of(run.sweep, START, *limits_of(run), "rigid_pitch")
    ways = tuple(planned(name, (f"world.ref={world}",), stated) for name, world, stated in WAYS)
    return Errata(
        ways=ways,
        orders=tuple(planned(name, (ROOM, *settings), stated) for name, settings, stated in ORDERS),
        quiet=cloud_of(ways[0].drive.sweep, START, *limits_of(ways[0].drive), "paper"),
        union=planned("union of all pixels", (ROOM, "mapper={plugin='union'}")),
        geometries=geometries,
        clouds=(true, cloud_of(run.sweep, START, *limits_of(run), "paper")),
        parts=(on_floor(true), *(on_box(true, box(run.world, name)) for name in ("girder A", "girder B"))),
        grids=tuple(
            planned(
                f"{cell}, {raster}, {GROWTH_NAMES[growth]}",
                (ROOM, f"planner.cell={edge}", f"planner.raster={rule}", f"planner.dilation_cells={growth}"),
            )
            for cell, edge in CELLS
            for raster, rule in RASTERS
            for growth in GROWTH_NAMES
        ),
        heights=tuple(planned(name, (ROOM, f"mapper.height_frame={frame}")) for name, frame in HEIGHTS),
        anchors=tuple(planned(name, (ROOM, f"planner.anchor={anchor}")) for name, anchor in ANCHORS),
        laws=settled(),
        gains=tuple(driven(k3) for k3 in GAINS),
    )


def limits_of(run: Drive) -> tuple[float, float]:
    """Floor tolerance and height limit of a run's mapper, m above the floor."""
    system = run.episode.system
    params = system.parts[("mapper", system.config.mapper.instance)].params
    z_limit = params.z_limit
    return float(params.floor_tolerance), float(system.robot.height if z_limit is None else z_limit)


def length_of(run: Drive) -> str:
    """Length of the plan before pruning and its gate as text, or "no path"."""
    if run.path is None:
        return "no path"
    return f"{run.path.length:.2f} m, gate {crossing(run.path, run.world)}"


def grown(occupied: Bools, cells: int) -> Bools:
    """Cells within a square of half width `cells` around an occupied one: the paper's dilation."""
    from scipy.ndimage import binary_dilation

    if cells == 0:
        return occupied
    return np.asarray(binary_dilation(occupied, np.ones((2 * cells + 1,) * 2)), dtype=np.bool_)


def off_the_walls(points: Floats, world: World) -> Floats:
    """(n,) horizontal distance of points (n, 3), m, map frame, from the nearest face of a box of the world, m."""
    distances = [np.full(len(points), np.inf)]
    for obstacle in world.obstacles:
        if isinstance(obstacle, Box) and not obstacle.appears_after_sweep:
            low, high = np.array([obstacle.x, obstacle.y]).T
            away = np.maximum(np.maximum(low - points[:, :2], points[:, :2] - high), 0.0)
            inside = np.minimum(points[:, :2] - low, high - points[:, :2]).min(axis=1)
            distances.append(np.where(inside > 0.0, inside, np.hypot(*away.T)))
    nearest: Floats = np.min(distances, axis=0)
    return nearest
