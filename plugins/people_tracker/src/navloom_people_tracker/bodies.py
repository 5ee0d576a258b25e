"""Bodies in one scan: what may be a person, a trolley or a robot, made of groups of echoes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from navloom_people_tracker.circles import arcs
from navloom_people_tracker.clusters import ARC, segments, shapes

__all__ = ["SIGMA_LEGS", "Bodies", "Widths", "bodies_in"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

LEG = 0.35
"""Widest group of echoes that may be a leg, m: trousers and coats included."""
THINNEST = 0.08
"""Width below which a group is no leg, m: poles and table legs come and go between the beams."""
STRIDE = 0.6
"""Largest distance between the legs of one person, m: at a brisk walk the ankles are up to 0.6 m apart."""
GAP = 0.15
"""Largest gap between neighbouring echoes of one group, m: less than there is between two people who pass."""
REACH = 0.35
"""Largest distance between a group and the track that it may belong to, m: half a stride."""
SOME_FRESH = 0.3
"""Share of fresh echoes from which all of a wide group is one body that moves."""
LEAST_FRESH = 3
"""Fewest echoes of something that moves before something wide: two may be the noise of an edge."""
BESIDE_DISC = 0.1
"""Distance of an echo from the outline of an expected disc within which it may be the disc's, m."""
SIGMA_ARC, SIGMA_DISC, SIGMA_LEGS, SIGMA_LEG = 0.015, 0.06, 0.1, 0.15
"""Standard deviation of the centre of a body: what is added to that of a fitted circle, of another, of a pair of legs
and of a single leg, m."""


class Widths(Protocol):
    """The largest body, m, for what moves and for what may stand, and the deviation of a range, m."""

    @property
    def widest(self) -> float: ...
    @property
    def widest_still(self) -> float: ...
    @property
    def range_sigma(self) -> float: ...


@dataclass
class Bodies:
    """Bodies in one scan, one row each.

    Attributes:
        places: (n, 2) centres, m.
        radii: (n,) m.
        errors: (n, 2, 2) covariance of the centres for a known radius, m².
        leans: (n, 2) shift x, y of the centre for each m by which the radius is larger than seen.
        radius_sigmas: (n,) standard deviation of the radius, m; inf where only a part of the width may be seen.
        surfaces: (n, 2) an echo of each, m.
        echoes: (n,) number of them.
        fresh: (n,) share of its echoes where nothing was before.
        is_in_free: (n,) whether most of its echoes are where a map is free.
        legs: (n,) number of legs, 1 or 2; 0 for another body.
        groups: (n,) the group of its echoes, of one leg if it has two.
    """

    places: Floats
    radii: Floats
    errors: Floats
    leans: Floats
    radius_sigmas: Floats
    surfaces: Floats
    echoes: Floats
    fresh: Floats
    is_in_free: Bools
    legs: Ints
    groups: Ints

    @classmethod
    def of(cls, rows: Floats, fits: Floats, groups: Ints, sensor: tuple[float, float]) -> Bodies:
        """Bodies of single groups with these numbers, whose rows are those of `clusters.shapes` and `clusters.arcs`."""
        legs = (rows[:, 4] < LEG).astype(np.int64)
        away = rows[:, :2] - np.array(sensor)
        sight = away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)[:, None]
        is_arc = fits[:, 5] > 0.0
        errors = np.where(legs > 0, SIGMA_LEG, SIGMA_DISC)[:, None, None] ** 2 * np.eye(2)
        of_arcs = fits[:, [0, 1, 1, 2]].reshape(-1, 2, 2) + SIGMA_ARC**2 * np.eye(2)
        leans = np.where(legs[:, None] > 0, 0.0, ARC * sight)
        return cls(
            rows[:, :2], rows[:, 2], np.where(is_arc[:, None, None], of_arcs, errors),
            np.where(is_arc[:, None], fits[:, 3:5], leans), np.where(is_arc, fits[:, 5], np.inf), rows[:, 5:7],
            rows[:, 3], rows[:, 7], rows[:, 8] > 0.5, legs, groups,
        )  # fmt: skip

    def rows(self, kept: Bools | Ints) -> Bodies:
        """Some of the bodies."""
        return Bodies(*[getattr(self, name)[kept] for name in self.__dataclass_fields__])

    def centred(self, radii: Floats, sigmas: Floats) -> tuple[Floats, Floats]:
        """(n, 2) centres, m, and covariances (n, 2, 2), m², of bodies with a radius (n,), m, and its deviation, m."""
        larger = radii - self.radii
        # What is hidden in part looks smaller than it is, never larger.
        larger = np.where(np.isfinite(self.radius_sigmas), larger, np.maximum(larger, 0.0))
        spread = sigmas[:, None, None] ** 2 * self.leans[:, :, None] * self.leans[:, None]
        return self.places + larger[:, None] * self.leans, self.errors + spread


def bodies_in(
    points: Floats, marks: Bools, sensor: tuple[float, float], step: float, expected: Floats, widths: Widths
) -> tuple[Bodies, Floats, Ints]:
    """Bodies in a scan, the (m, 2) echoes that were looked at, m, and the (m,) group of each.

    Args:
        points: (n, 2) echoes that no map explains, by their bearing from the sensor, m.
        marks: (n, 2) whether each is where nothing was before, and whether it is where a map is free.
        sensor: Its place, m, same frame. step: Angle between neighbouring beams, rad.
        expected: (k, 3) where published tracks are expected, x, y, m, and the radius of those that are discs, m, or 0.
        widths: The largest body.
    """
    labels, rows = _grouped(points, marks, sensor, step)
    # A person before a wall, without a map: of something wide, only what moves may be a body.
    moves = (rows[:, 7] >= SOME_FRESH) & (rows[:, 7] * rows[:, 3] >= LEAST_FRESH)
    is_wide = rows[:, 4] > np.where(moves, widths.widest, widths.widest_still)
    own = np.zeros(len(points), np.bool_)
    if is_wide.any():
        own = is_wide[labels]
        kept = ~own | marks[:, 0] | _on_discs(points, sensor, expected)
        points, marks, own = points[kept], marks[kept], own[kept]
        labels, rows = _grouped(points, marks, sensor, step)
    labels, count = _split(points, labels, rows, expected)
    if count > len(rows):
        rows = np.zeros((count, 9))
        shapes(points, marks, labels, *sensor, step, rows)
    from_wide = np.bincount(labels[own], minlength=count) > 0
    dropped = (from_wide & (rows[:, 3] < LEAST_FRESH)) | (rows[:, 4] > widths.widest)
    far = np.hypot(rows[:, 0] - sensor[0], rows[:, 1] - sensor[1])
    dropped |= (rows[:, 3] + 1.0) * step * far < THINNEST  # the beams beside the echoes pass it
    fits = np.empty((len(rows), 6))
    arcs(points, labels, widths.range_sigma, LEG, widths.widest, rows, fits)
    whole = np.flatnonzero(~dropped & (rows[:, 3] > 0.0))
    found = Bodies.of(rows[whole], fits[whole], whole, sensor)
    return _paired(found, expected), points, labels


def _grouped(points: Floats, marks: Bools, sensor: tuple[float, float], step: float) -> tuple[Ints, Floats]:
    labels = np.zeros(len(points), np.int64)
    far = np.hypot(points[:, 0] - sensor[0], points[:, 1] - sensor[1])
    rows = np.empty((segments(points, far, step, GAP, labels), 9))
    shapes(points, marks, labels, *sensor, step, rows)
    return labels, rows


def _on_discs(points: Floats, sensor: tuple[float, float], expected: Floats) -> Bools:
    """(n,) which echoes are of an expected disc, on its side that the sensor sees: it is known beside something too."""
    discs = expected[expected[:, 2] > 0.0]
    off = points[:, None] - discs[None, :, :2]
    is_near = np.abs(np.hypot(off[..., 0], off[..., 1]) - discs[:, 2]) < BESIDE_DISC
    is_before = (off * (np.array(sensor) - discs[:, :2])).sum(axis=2) > 0.0
    return np.asarray((is_near & is_before).any(axis=1))


def _split(points: Floats, labels: Ints, rows: Floats, expected: Floats) -> tuple[Ints, int]:
    """Groups of echoes, and how many; a group with two tracks or more is divided between them."""
    count = len(rows)
    if len(expected) < 2 or not count:
        return labels, count
    away = np.hypot(rows[:, None, 0] - expected[None, :, 0], rows[:, None, 1] - expected[None, :, 1])
    holds = away < 0.5 * rows[:, 4:5] + 0.1
    for group in np.flatnonzero((holds.sum(axis=1) > 1) & (rows[:, 4] >= LEG)):
        own = np.flatnonzero(labels == group)
        those = expected[holds[group], :2]
        nearest = np.hypot(
            points[own, None, 0] - those[None, :, 0], points[own, None, 1] - those[None, :, 1]
        ).argmin(axis=1)  # fmt: skip
        for number in range(1, len(those)):
            labels[own[nearest == number]] = count
            count += 1
    return labels, count


def _paired(found: Bodies, expected: Floats) -> Bodies:
    """Bodies whose legs are paired, the nearest ones first, but not the legs of two tracks."""
    legs = np.flatnonzero(found.legs > 0)
    if len(legs) < 2:
        return found
    places = found.places[legs]
    away = np.hypot(places[:, None, 0] - places[None, :, 0], places[:, None, 1] - places[None, :, 1])
    first, second = np.nonzero(np.triu(away < STRIDE, 1))
    owner = np.full(len(legs), -1)
    if len(expected):
        to = np.hypot(places[:, None, 0] - expected[None, :, 0], places[:, None, 1] - expected[None, :, 1])
        to = np.maximum(to - expected[:, 2], 0.0)
        owner = np.where(to.min(axis=1) < REACH, to.argmin(axis=1), -1)
    is_disc = (owner >= 0) & (expected[owner, 2] > 0.0) if len(expected) else np.zeros(len(legs), np.bool_)
    apart = (owner[first] >= 0) & (owner[second] >= 0) & (owner[first] != owner[second])
    apart |= is_disc[first] | is_disc[second]  # a part of a disc is no leg
    same = (owner[first] >= 0) & (owner[first] == owner[second])
    allowed = ~apart
    first, second, same = first[allowed], second[allowed], same[allowed]
    order = np.lexsort([away[first, second], ~same])
    taken, pairs = set[int](), []
    for i, j in zip(first[order].tolist(), second[order].tolist(), strict=True):
        if i not in taken and j not in taken:
            taken.update((i, j))
            pairs.append((i, j))
    if not pairs:
        return found
    rows = np.array(pairs)
    ones, others = legs[rows[:, 0]], legs[rows[:, 1]]
    found.radii[ones] = 0.5 * away[rows[:, 0], rows[:, 1]] + np.maximum(found.radii[ones], found.radii[others])
    found.places[ones] = 0.5 * (found.places[ones] + found.places[others])
    found.echoes[ones] += found.echoes[others]
    found.fresh[ones] = np.maximum(found.fresh[ones], found.fresh[others])
    found.errors[ones], found.legs[ones] = SIGMA_LEGS**2 * np.eye(2), 2
    return found.rows(np.delete(np.arange(len(found.legs)), others))
