"""Shortest path of a disc's centre around obstacles: straight tangents and arcs, on the tangent graph.

A shortest path among obstacles inflated by a disc consists of segments that touch two inflation arcs (or an end of the
path) and of parts of these arcs (Laumond 1987; Liu & Arimoto 1992). Given the circles of all arcs, the shortest path in
the graph of all free tangents and arcs is exactly the shortest path.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from navloom.geometry.compiled import compiled
from numpy.typing import NDArray

from navloom_optimal.free_space import Space

__all__ = ["Circles", "ShortestPath", "on_arc", "shortest_among"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_ANGLE_SLACK = 1e-9
_ARC_SAMPLE = math.radians(5.0)


@dataclass(frozen=True, eq=False)
class Circles:
    """Circles whose arcs a path may follow; radius 0 is a point that it may pass.

    Attributes:
        places: (n, 3) centre x, y and radius, m.
        usable: (n, 2) first angle and extent of the arc that bounds the inflated obstacle, rad; extent 2π is a whole
            circle.
        owners: (n,) number of the obstacle that the circle surrounds, boxes first, or -1.
    """

    places: Floats
    usable: Floats
    owners: Ints

    def __len__(self) -> int:
        return len(self.places)

    def chosen(self, mask: Bools) -> Circles:
        """The circles selected by a mask (n,)."""
        return Circles(self.places[mask], self.usable[mask], self.owners[mask])


@dataclass(frozen=True, eq=False)
class ShortestPath:
    """A path: its length, m, and (n, 2) points along it, m; arcs are sampled every 5 degrees."""

    length: float
    points: Floats


def shortest_among(circles: Circles, space: Space, longest: float = math.inf) -> ShortestPath | None:
    """Shortest free path from the centre of circle 0 to that of circle 1, both of radius 0; None if there is none.

    Args:
        circles: The two ends, then every circle that may bend the path.
        space: Free space of the disc's centre.
        longest: Largest distance of two circles' centres for a tangent between them, m.
    """
    touched, angles, segments = _free_tangents(circles, space, longest)
    points = segments.reshape(-1, 2)
    on_circle = touched.reshape(-1)
    at_angle = angles.reshape(-1)
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    ends = np.arange(len(points)).reshape(-1, 2)
    arc_ends, arc_lengths, arc_angles = _free_arcs(circles, space, on_circle, at_angle)
    # Each end of the path acts as one vertex: its circle has radius 0, so arcs of length 0 join its points.
    starts, goals = np.flatnonzero(on_circle == 0), np.flatnonzero(on_circle == 1)
    if not (starts.size and goals.size):
        return None
    edges = np.concatenate([ends, arc_ends])
    weights = np.concatenate([lengths, arc_lengths])
    order, offsets, targets = _adjacency(edges, len(points))
    total, previous, by_edge = _dijkstra(
        offsets, targets, np.concatenate([weights, weights])[order], starts[0], goals[0]
    )
    if not math.isfinite(total):
        return None
    track = [points[goals[:1]]]
    vertex = int(goals[0])
    while vertex != starts[0]:
        arc = int(order[by_edge[vertex]]) % len(edges) - len(ends)
        if arc >= 0:
            from_first = arc_ends[arc, 0] == vertex
            track.append(
                on_arc(circles.places[on_circle[vertex]], arc_angles[arc] if from_first else arc_angles[arc, ::-1])
            )
        vertex = int(previous[vertex])
        track.append(points[vertex][None])
    return ShortestPath(float(total), np.concatenate(track)[::-1])


def on_arc(circle: Floats, angles: Floats) -> Floats:
    """(n, 2) points of an arc on a circle (3,), from the first to the last of two angles, rad."""
    sampled = np.linspace(angles[0], angles[1], 2 + int(abs(angles[1] - angles[0]) / _ARC_SAMPLE))
    points: Floats = circle[:2] + circle[2] * np.stack([np.cos(sampled), np.sin(sampled)], axis=-1)
    return points


def _free_tangents(circles: Circles, space: Space, longest: float) -> tuple[Ints, Floats, Floats]:
    """All free segments that touch two circles.

    Returns:
        (m, 2) the circles, (m, 2) angles of the points of contact, rad, (m, 4) the segments x1, y1, x2, y2, m.
    """
    touched, angles, segments = [], [], []
    for first in range(len(circles) - 1):
        others, at, ends = _tangents_of(circles, first, longest)
        free = space.segments_free(ends)
        touched.append(np.stack([np.full(int(free.sum()), first), others[free]], axis=-1))
        angles.append(at[free])
        segments.append(ends[free])
    return np.concatenate(touched), np.concatenate(angles), np.concatenate(segments)


def _tangents_of(circles: Circles, first: int, longest: float) -> tuple[Ints, Floats, Floats]:
    """Segments that touch circle `first` and a later one within their usable arcs.

    Let n be the unit normal of a tangent, from the first centre to its point of contact, and s = 1 for outer, -1 for
    inner tangents. Then n · (c2 - c1) = r1 - s r2, and the contacts are c1 + r1 n and c2 + s r2 n.
    """
    here, later = circles.places[first], circles.places[first + 1 :]
    candidates = first + 1 + np.flatnonzero(np.hypot(later[:, 0] - here[0], later[:, 1] - here[1]) <= longest)
    there, usable_there = circles.places[candidates], circles.usable[candidates]
    offset = there[:, :2] - here[:2]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    found = []
    for kind in (1.0, -1.0):
        with np.errstate(divide="ignore", invalid="ignore"):
            cosine = (here[2] - kind * there[:, 2]) / distance
        exists = np.abs(cosine) <= 1.0
        if kind < 0.0:
            # At a point (radius 0), inner and outer tangents are the same.
            exists &= (there[:, 2] > 0.0) & (here[2] > 0.0)
        spread = np.arccos(np.where(exists, cosine, 0.0))
        for side in (1.0, -1.0):
            mine = bearing + side * spread
            theirs = mine if kind > 0.0 else mine + np.pi
            usable = exists & _within(mine, circles.usable[first]) & _within(theirs, usable_there)
            if side < 0.0:
                usable = usable & ((there[:, 2] > 0.0) | (here[2] > 0.0))
            k = np.flatnonzero(usable)
            found.append((candidates[k], np.stack([mine[k], theirs[k]], axis=-1)))
    others = np.concatenate([k for k, _ in found])
    angles = np.concatenate([a for _, a in found])
    reached = circles.places[others]
    starts = here[:2] + here[2] * np.stack([np.cos(angles[:, 0]), np.sin(angles[:, 0])], axis=-1)
    ends = reached[:, :2] + reached[:, 2:] * np.stack([np.cos(angles[:, 1]), np.sin(angles[:, 1])], axis=-1)
    return others, angles, np.concatenate([starts, ends], axis=-1)


def _within(angle: Floats, usable: Floats) -> Bools:
    """Whether angles, rad, are within arcs (..., 2) first angle, extent, rad."""
    past = np.mod(angle - usable[..., 0] + _ANGLE_SLACK, 2.0 * np.pi) - _ANGLE_SLACK
    inside: Bools = past <= usable[..., 1] + _ANGLE_SLACK
    return inside


def _free_arcs(circles: Circles, space: Space, on_circle: Ints, at_angle: Floats) -> tuple[Ints, Floats, Floats]:
    """Free arcs between neighbouring points of contact.

    Args:
        on_circle, at_angle: (n,) circle and angle, rad, of each point.

    Returns:
        (m, 2) indices of the points that they join, (m,) lengths, m, (m, 2) first and last angle, rad.
    """
    first_angle = circles.usable[on_circle, 0]
    past = np.mod(at_angle - first_angle + _ANGLE_SLACK, 2.0 * np.pi) - _ANGLE_SLACK
    order = np.lexsort((past, on_circle))
    same = on_circle[order[1:]] == on_circle[order[:-1]]
    ends = np.stack([order[:-1], order[1:]], axis=-1)[same]
    spans = np.stack([past[ends[:, 0]], past[ends[:, 1]]], axis=-1)
    # Whole circles are closed by an arc from their last point to their first.
    opens = np.flatnonzero(np.concatenate([[True], ~same]))[: len(order)]
    closes = np.append(opens[1:], len(order)) - 1
    closing = np.stack([order[closes], order[opens]], axis=-1)
    whole = (circles.usable[on_circle[closing[:, 0]], 1] > 6.28) & (circles.places[on_circle[closing[:, 0]], 2] > 0.0)
    closing = closing[whole & (opens < closes)]
    ends = np.concatenate([ends, closing])
    spans = np.concatenate([spans, np.stack([past[closing[:, 0]], past[closing[:, 1]] + 2.0 * np.pi], axis=-1)])
    on = on_circle[ends[:, 0]]
    angles = spans + circles.usable[on, :1]
    free = (circles.places[on, 2] == 0.0) | space.arcs_free(circles.places[on], angles, circles.owners[on])
    lengths = (spans[:, 1] - spans[:, 0]) * circles.places[on, 2]
    return ends[free], lengths[free], angles[free]


def _adjacency(edges: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """Both directions of edges (m, 2), sorted by source: order (2 m,), offsets (count + 1,) and targets (2 m,)."""
    sources = np.concatenate([edges[:, 0], edges[:, 1]])
    order = np.argsort(sources, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(sources, minlength=count))])
    return order, offsets, np.concatenate([edges[:, 1], edges[:, 0]])[order]


@compiled
def _dijkstra(offsets: Ints, targets: Ints, weights: Floats, start: int, goal: int) -> tuple[float, Ints, Ints]:
    """Length of the shortest path, and for each vertex its predecessor and the index of the edge between them."""
    count = offsets.shape[0] - 1
    cost = np.full(count, np.inf)
    previous = np.full(count, -1, dtype=np.int64)
    by_edge = np.full(count, -1, dtype=np.int64)
    cost[start] = 0.0
    heap = [(0.0, start)]
    while len(heap) > 0:
        reached, vertex = heapq.heappop(heap)
        if vertex == goal:
            break
        if reached > cost[vertex]:
            continue
        for k in range(offsets[vertex], offsets[vertex + 1]):
            through = reached + weights[k]
            if through < cost[targets[k]]:
                cost[targets[k]] = through
                previous[targets[k]] = vertex
                by_edge[targets[k]] = k
                heapq.heappush(heap, (through, targets[k]))
    return cost[goal], previous, by_edge
