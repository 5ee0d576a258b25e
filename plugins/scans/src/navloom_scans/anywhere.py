"""Search for the robot over a whole map: the places where a scan fits best, complete, and in slices of bounded work.

Branch and bound over a pyramid of maxima (Olson 2009; Hess et al. 2016) finds the best positions and headings of a
lattice. The score of a place is the share of end points at mapped walls, less the share of beams that pass through
mapped walls. An echo before a mapped wall is that of something the map lacks: it only adds nothing. Each place is then
fitted and scored with what its beams see along the map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navloom_scans import matching, sight
from navloom_scans.field import DistanceField, distance_field
from navloom_scans.lattice import COMPLETE, DIVE, DRAIN, FULL, expand, offsets_of, pyramid_of
from navloom_scans.poses import pose_of
from navloom_scans.sight import look_along

__all__ = ["MapSearch", "SearchSettings", "warm_up"]

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_ANYWHERE = (math.inf, math.inf)
_MAX_CELLS = 4_000_000
"""Most lattice cells. On a larger map the cells are doubled: a pyramid has one byte per cell and level."""
_MAX_SIDE = 32_000
"""Most cells in one direction: a node of the queue has 16 bits for each."""
_REFINE_WORK = 200
"""Work of fitting and scoring one place, in nodes."""
_FIRST_CAPACITY = 1 << 14
"""Nodes for which the queue has room at first; it grows."""


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """Settings of the search.

    Attributes:
        step: Spacing of the positions, m; doubled on maps of more than 4 million such cells.
        least_turn, most_turn: Limits of the spacing of the headings, rad. Between them, a step of heading moves the
            median end point by 1.5 `step`.
        width: Misfit from which an end point adds nothing, m.
        beams: Largest number of end points that are used.
        sparse: Of the end points in a square of this edge, m, one is used: near things take no more than far ones.
        levels: Levels of the pyramid.
        least: Least score of a place, 0 to 1.
        margin: Largest difference of a place's score from the best one's.
        clearance: Least distance of the base from a wall, m.
        apart, turned: Least distance of two places, m, or of their headings, rad.
        gate: Depth behind a wall's front from which a beam passes through it, m, on the lattice.
        sigma, redundancy, robust_scale, reach, iterations: As those of `scan_matching`, for the final fits.
        most_work: Nodes after which the search goes on with the best position of each node, for a fifth of that.
    """

    step: float = 0.1
    least_turn: float = math.radians(1.0)
    most_turn: float = math.radians(4.0)
    width: float = 0.25
    beams: int = 72
    sparse: float = 0.2
    levels: int = 5
    least: float = 0.25
    margin: float = 0.25
    clearance: float = 0.1
    apart: float = 0.5
    turned: float = math.radians(15.0)
    gate: float = 0.4
    sigma: float = 0.02
    redundancy: float = 10.0
    robust_scale: float = 0.08
    reach: float = 0.5
    iterations: int = 8
    most_work: int = 2_000_000


class MapSearch:
    """Finds where on a map a scan may have been taken.

    `search` returns the places at once. `begin` and `step` do the same in slices, each of a given amount of work and
    not of time, so that a run repeats bit for bit.

    Attributes:
        is_complete: Whether the last search found the best places for certain; `most_work` ended it otherwise.
        work: Work of the last search, in nodes.
        shape: Extent of the map along y and x of its raster, m.
        bytes: Memory of the pyramid, of the places where the robot may stand, and of the queue of the last search.
    """

    def __init__(self, field: DistanceField, free: Bools, settings: SearchSettings = SearchSettings()) -> None:
        """Prepare a map.

        Args:
            field: Distance field of the map, of a reach of at least `width`.
            free: (rows, columns) cells of the map that are known to be free.
            settings: Settings.
        """
        self.settings, self.field = settings, field
        cell, self._heading = 2.0 * float(field.frame[4]), math.atan2(field.frame[3], field.frame[2])
        rows, columns = free.shape
        step = settings.step
        while (
            math.ceil(rows * cell / step) * math.ceil(columns * cell / step) > _MAX_CELLS
            or max(rows, columns) * cell / step > _MAX_SIDE
        ):
            step *= 2.0
        self._step, width = step, settings.width * step / settings.step
        v, u = (
            (np.arange(max(1, math.ceil(count * cell / step - 1e-9))) + 0.5) * step / cell for count in (rows, columns)
        )
        near = np.ix_(_index(2.0 * v, 2 * rows + 1), _index(2.0 * u, 2 * columns + 1))
        distance = field.values[near]
        values = np.rint(FULL * np.clip(1.0 - np.abs(distance) / width, 0.0, 1.0)).astype(np.uint8)
        may_stand = free[np.ix_(_index(v - 0.5, rows), _index(u - 0.5, columns))] & (distance > settings.clearance)
        self._pyramid = pyramid_of(values, settings.levels)
        self._standing = _blocks(may_stand, settings.levels)
        self.shape = (rows * cell, columns * cell)
        self._queue = np.empty((0, 3), dtype=np.int32)
        self.is_complete, self.work = True, 0
        self._is_over, self._places, self._scores = True, np.empty((0, 3)), np.empty(0)

    @property
    def bytes(self) -> int:
        return int(self._pyramid.nbytes + self._standing.nbytes + self._queue.nbytes)

    def search(
        self,
        beams: Floats,
        echoes: int,
        count: int,
        near: Floats | None = None,
        sigma: tuple[float, float] = _ANYWHERE,
    ) -> tuple[Floats, Floats]:
        """The best places of a scan, all at once; see `begin` and `result`."""
        self.begin(beams, echoes, count, near, sigma)
        while not self.step(1_000_000):
            pass
        return self.result()

    def begin(
        self,
        beams: Floats,
        echoes: int,
        count: int,
        near: Floats | None = None,
        sigma: tuple[float, float] = _ANYWHERE,
    ) -> None:
        """Begin a search; one that has not ended is dropped.

        Args:
            beams: (n, 4) end point, m, and direction, base frame; first those with an echo, then those without one,
                which end at the range of the sensor.
            echoes: Number of beams with an echo.
            count: Largest number of places.
            near: (3,) x, y, m, heading, rad, map frame, of a guess; None for the whole map.
            sigma: Standard deviations of the guess, m and rad: positions within three of them on each axis of the map's
                raster, and headings within three of them, are searched.
        """
        s = self.settings
        self.work, self.is_complete = 0, True
        self._is_over, self._places, self._scores = False, np.empty((0, 3)), np.empty(0)
        self._refined: list[tuple[float, Floats]] = []
        self._rays, self._count = self.rays_of(beams, echoes)
        used = self._rays[: self._count]
        self._corners = np.array([[0, 0], [n - 1 for n in self._standing.shape[1:]]])
        middle, half = 0.0, math.pi
        if near is not None:
            f, reach = self.field.frame, 3.0 * sigma[0]
            x, y = near[0] - f[0], near[1] - f[1]
            at = np.array([f[2] * y - f[3] * x, f[2] * x + f[3] * y])
            if math.isfinite(reach):
                window = np.floor(np.array([at - reach, at + reach]) / self._step)
                self._corners = np.clip(window, [[0, 0], [0, 0]], self._corners[1]).astype(np.int64)
            middle, half = float(near[2]) - self._heading, min(math.pi, 3.0 * sigma[1])
        far = float(np.median(np.hypot(used[:, 0], used[:, 1]))) if len(used) else 1.0
        turn = min(max(1.5 * self._step / max(far, 1e-9), s.least_turn), s.most_turn)
        headings = math.ceil(math.tau / turn) if half >= math.pi else 2 * math.ceil(half / turn) + 1
        spacing = math.tau / headings if half >= math.pi else (2.0 * half / max(headings - 1, 1))
        self._turns = middle + (np.arange(headings) - (headings // 2)) * spacing
        self._offsets = offsets_of(used, self._turns, self._step)
        self._heads = np.full(FULL * max(len(used), 1) + 1, -1)
        self._queue = np.empty((_FIRST_CAPACITY, 3), dtype=np.int32)
        self._marks = np.array([0, 0, -1, 0, 0])
        self._found = np.empty((max(count, 1), 4))
        share = FULL * max(len(used), 1)
        self._limits = np.array(
            [self._step, s.gate, FULL, s.apart, s.turned, max(1.0, s.least * share), s.margin * share]
        )
        self._mode: int | None = COMPLETE if len(used) and count > 0 else None
        self._limit_of_work = s.most_work

    def step(self, budget: int) -> bool:
        """Continue a search by some work, in nodes; whether it has ended. A node is about 0.1 to 0.3 µs."""
        while budget > 0 and not self._is_over:
            if self._mode is not None:
                room = min(budget, self._limit_of_work - self.work)
                work, is_done = expand(
                    self._pyramid, self._standing, self._corners, self._offsets, self._turns, self.field.values,
                    self.field.frame, self._rays, self._count, self._limits, self._queue, self._heads, self._marks,
                    self._found, self._mode, room,
                )  # fmt: skip
                budget, self.work = budget - work, self.work + work
                if self._marks[1] + 8 >= len(self._queue):
                    self._queue = np.concatenate((self._queue, np.empty_like(self._queue)))
                if is_done or self.work >= self._limit_of_work:
                    self._end(is_done)
            elif len(self._refined) < self._marks[4]:
                self._refined.append(self._refine(self._found[len(self._refined)]))
                budget, self.work = budget - _REFINE_WORK, self.work + _REFINE_WORK
            else:
                self._finish()
        return self._is_over

    def _end(self, is_done: bool) -> None:
        """End a way of searching: a complete one that takes too long goes on with the best position of each node."""
        if is_done:
            self._mode = None
            return
        self.is_complete = False
        self._mode = DIVE if self._mode == COMPLETE else DRAIN
        self._limit_of_work += self.settings.most_work // 5 if self._mode == DIVE else 1 << 40

    def result(self) -> tuple[Floats, Floats]:
        """(k, 3) poses of a search that has ended, map frame, the best first, and their (k,) scores, at most 1."""
        return self._places, self._scores

    def rays_of(self, beams: Floats, echoes: int) -> tuple[Floats, int]:
        """The beams of a scan that a search uses, (m, 4), see `begin`, and how many of them have an echo."""
        s = self.settings
        heard = _spread(_sparse(beams[:echoes], s.sparse), s.beams)
        return np.concatenate((heard, _spread(beams[echoes:], s.beams // 3))), len(heard)

    def score_of(self, pose: Floats, rays: Floats | None = None, heard: int = 0) -> float:
        """Score of a pose, (3,) map frame, for the scan of the last search, or for one of `rays_of`."""
        if rays is None:
            rays, heard = self._rays, self._count
        return look_along(self.field, rays, heard, pose, 2.0 * self.settings.robust_scale).score

    def fitted(self, place: Floats, rays: Floats, heard: int) -> Floats:
        """The pose near a place, both (3,) map frame, at which the rays of a scan fit best."""
        s = self.settings
        loose = np.diag([1.0 / 0.3**2, 1.0 / 0.3**2, 1.0 / math.radians(6.0) ** 2])
        options = np.array([s.sigma**2 * s.redundancy, 0.3, s.robust_scale, 2.0 * s.robust_scale, s.reach])
        pose, fused, used = np.empty(3), np.empty((3, 3)), rays[:heard]
        matching.fit_pose(self.field.values, self.field.frame, used, place, loose, options, s.iterations, pose, fused)
        return pose_of(*(pose if np.isfinite(pose).all() else place).tolist())

    def _refine(self, row: Floats) -> tuple[float, Floats]:
        """Score and pose of a result, fitted."""
        f, u, v = self.field.frame, (row[2] + 0.5) * self._step, (row[1] + 0.5) * self._step
        place = np.array(
            [f[0] + f[2] * u - f[3] * v, f[1] + f[3] * u + f[2] * v, self._turns[int(row[0])] + self._heading]
        )
        pose = self.fitted(place, self._rays, self._count)
        return self.score_of(pose), pose

    def _finish(self) -> None:
        """Order the places by their scores; of two that the fit moved to one place, keep the better."""
        kept: list[tuple[float, Floats]] = []
        for score, pose in sorted(self._refined, key=lambda place: -place[0]):
            if all(_is_apart(pose, other, self.settings) for _, other in kept):
                kept.append((score, pose))
        self._places = np.array([pose for _, pose in kept]).reshape(-1, 3)
        self._scores = np.array([score for score, _ in kept])
        self._is_over = True


def _is_apart(pose: Floats, other: Floats, s: SearchSettings) -> bool:
    off = math.hypot(pose[0] - other[0], pose[1] - other[1])
    return off >= 0.5 * s.apart or abs(math.remainder(pose[2] - other[2], math.tau)) >= 0.5 * s.turned


def _index(places: Floats, count: int) -> NDArray[np.int64]:
    """Nearest of `count` nodes, for places in nodes."""
    return np.clip(np.rint(places - 1e-9), 0, count - 1).astype(np.int64)


def _blocks(cells: Bools, levels: int) -> Bools:
    """(levels, rows, columns) whether any cell of each block of 2^level cells is set."""
    size = 2 ** (levels - 1)
    rows, columns = (-(-n // size) * size for n in cells.shape)
    found = np.zeros((levels, rows, columns), dtype=np.bool_)
    found[0, : cells.shape[0], : cells.shape[1]] = cells
    for level in range(1, levels):
        rows, columns = rows // 2, columns // 2
        below = found[level - 1, : 2 * rows, : 2 * columns]
        found[level, :rows, :columns] = below.reshape(rows, 2, columns, 2).any(axis=(1, 3))
    return found


def _sparse(beams: Floats, size: float) -> Floats:
    """The first beam that ends in each square of an edge, m, of those in the base frame."""
    _, first = np.unique(np.floor(beams[:, :2] / size).astype(np.int64), axis=0, return_index=True)
    return beams[np.sort(first)]


def _spread(beams: Floats, count: int) -> Floats:
    """At most `count` beams, evenly over their order."""
    if len(beams) <= count:
        return np.ascontiguousarray(beams)
    return np.ascontiguousarray(beams[np.arange(count) * len(beams) // count])


def warm_up() -> None:
    """Compile the kernels."""
    walls = np.zeros((8, 8), dtype=np.bool_)
    walls[:, 0] = True
    field = distance_field(walls, 0.1, (0.0, 0.0, 0.0), 1.0)
    matching.warm_up()
    sight.warm_up()
    MapSearch(field, ~walls).search(np.array([[-0.3, 0.0, -1.0, 0.0]]), 1, 1)
