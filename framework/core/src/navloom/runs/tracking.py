"""How well a tracker knew the bodies that move: its tracks beside the true bodies. Definitions: docs/metrics.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.cells import cells_at, has_cells
from navloom.geometry.grid import world_to_grid
from navloom.geometry.world import World
from navloom.messages import Message, OccupancyGrid, Pose2D, Tracks
from navloom.runs.moving_bodies import MovingBodies
from navloom.runs.ospa import Ospa, assignment, distances, ospa

__all__ = ["CUTOFF", "ORDER", "REACH", "Moment", "Tracking", "tracking_of"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

CUTOFF, ORDER = 1.0, 1.0
"""Cut-off, m, and order of the OSPA distance: of order 1, it is the sum of its two parts."""
REACH = 8.0
"""Distance from the robot up to which bodies are to be tracked, m."""
BESIDE = 1.0
"""How much farther off tracks count, m."""
CELL, BEFORE = 0.1, 0.3
"""Edge of the cells in which lines of sight are looked at, and where a line ends before the centre of a body, m."""
BRIEF = 1.0
"""A body that is in view for less than this time need not be found, s."""


@dataclass(frozen=True, eq=False)
class Moment:
    """Tracks and bodies at one time.

    Attributes:
        time: s.
        ids: (n,) of the tracks that count.
        found, speeds: (n, 2) their positions, m, and velocities, m/s.
        bodies: (k,) numbers of the bodies in view.
        truth, true_speeds: (k, 2) the same of these.
    """

    time: float
    ids: NDArray[np.int64]
    found: Floats
    speeds: Floats
    bodies: NDArray[np.int64]
    truth: Floats
    true_speeds: Floats

    @cached_property
    def ospa(self) -> Ospa:
        """Distance of the tracks from the bodies in view."""
        return ospa(self.truth, self.found, CUTOFF, ORDER)

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Rows of a body and of its track, which is within the cut-off."""
        away = distances(self.truth, self.found)
        columns = assignment(np.minimum(away, CUTOFF)).tolist() if away.size else []
        return [(row, column) for row, column in enumerate(columns) if column >= 0 and away[row, column] < CUTOFF]


@dataclass(frozen=True, eq=False)
class Tracking:
    """The tracks of an episode beside the truth.

    Attributes:
        moments: One for each message of the tracker.
        has_truth: Whether the true bodies are known.
    """

    moments: Sequence[Moment] = field(default_factory=tuple)
    has_truth: bool = False

    @cached_property
    def distances(self) -> Floats:
        """(n, 3) OSPA distance, its location and its cardinality part, m, where there is a body or a track."""
        return np.array([one.ospa for one in self.moments if len(one.bodies) or len(one.ids)]).reshape(-1, 3)

    @cached_property
    def false_tracks(self) -> int:
        """Number of tracks that were never within the cut-off of a body in view."""
        every, true = set[int](), set[int]()
        for one in self.moments:
            every.update(one.ids.tolist())
            if len(one.bodies):
                true.update(one.ids[(distances(one.truth, one.found) < CUTOFF).any(axis=0)].tolist())
        return len(every - true)

    @property
    def duration(self) -> float:
        """Time from the first message to the last, s."""
        return self.moments[-1].time - self.moments[0].time if self.moments else 0.0

    @cached_property
    def speed_errors(self) -> Floats:
        """(n,) differences between the velocity of a track and of its body, m/s."""
        away = [one.speeds[column] - one.true_speeds[row] for one in self.moments for row, column in one.pairs]
        given = np.array(away).reshape(-1, 2)
        errors: Floats = np.hypot(given[:, 0], given[:, 1])
        return errors[np.isfinite(errors)]

    @cached_property
    def latencies(self) -> list[float]:
        """Of each body, the time in view before its first track, s; all of it for one that had none."""
        seen, known = dict[int, float](), set[int]()
        before = self.moments[0].time if self.moments else 0.0
        for one in self.moments:
            span, before = one.time - before, one.time
            for body in one.bodies.tolist():
                seen[body] = seen.get(body, 0.0) + (0.0 if body in known or body not in seen else span)
            known.update(int(one.bodies[row]) for row, _ in one.pairs)
        return [time for body, time in seen.items() if body in known or time >= BRIEF]


def tracking_of(
    streams: Mapping[tuple[str, str], Sequence[tuple[float, Message]]],
    bodies: MovingBodies,
    robot: Floats,
    world: World | None,
    height: float,
) -> Tracking:
    """The tracks of the first node that gives some, beside the truth.

    Args:
        streams: Messages by stream, each after its time, s.
        bodies: The bodies that move.
        robot: (n, 3) time, s, x, y, m, of the robot at each tick.
        world: The ground truth. height: Of the robot, m.
    """
    given = next((kept for kept in streams.values() if kept and isinstance(kept[0][1], Tracks)), ())
    if not given or not len(robot):
        return Tracking()
    rows = [min(int(np.searchsorted(robot[:, 0], message.stamp_ns * 1e-9 - 1e-9)), len(robot) - 1)
            for _, message in given if isinstance(message, Tracks)]  # fmt: skip
    in_view = _in_view(bodies, rows, robot, world, height)
    moments = [
        _moment(message, robot[row, 1:3], bodies, row, seen)
        for (_, message), row, seen in zip(given, rows, in_view, strict=True)
        if isinstance(message, Tracks)
    ]
    return Tracking(moments, True)


def _moment(message: Tracks, robot: Floats, bodies: MovingBodies, row: int, seen: Bools) -> Moment:
    near = np.hypot(*(message.positions - robot).T) < REACH + BESIDE
    ids, found, speeds = message.ids[near], message.positions[near], message.velocities[near]
    there = np.flatnonzero(np.isfinite(bodies.places[row, :, 0]))
    hidden = there[~seen[there]]
    if len(hidden) and len(ids):
        # A track may foresee a body that is hidden: it is neither asked for nor false.
        away = distances(bodies.places[row, there], found)
        columns = assignment(np.minimum(away, CUTOFF))
        foreseen = np.flatnonzero(np.isin(there, hidden) & (columns >= 0))
        foreseen = foreseen[away[foreseen, columns[foreseen]] < CUTOFF]
        kept = np.delete(np.arange(len(ids)), columns[foreseen])
        ids, found, speeds = ids[kept], found[kept], speeds[kept]
    own = there[seen[there]]
    true = bodies.places[row, own], bodies.velocities[row, own]
    return Moment(message.stamp_ns * 1e-9, ids, found, speeds, own, *true)


def _in_view(bodies: MovingBodies, rows: Sequence[int], robot: Floats, world: World | None, height: float) -> Bools:
    """(len(rows), k) which bodies are near, with nothing that stands on the line between their centre and the robot."""
    if world is None or not bodies.places.size:
        return np.zeros((len(rows), len(bodies.radii)), np.bool_)
    places, eyes = bodies.places[rows], robot[rows, 1:3]
    away = places - eyes[:, None]
    far = np.hypot(away[..., 0], away[..., 1])
    seen = far < REACH  # False for NaN
    drawn = world_to_grid(world, CELL, (0.0, height))
    grid = OccupancyGrid(drawn.cells, CELL, Pose2D(drawn.origin.x, drawn.origin.y, 0.0))
    for row, column in zip(*np.nonzero(seen), strict=True):
        shares = np.arange(0.0, max(far[row, column] - BEFORE, 0.0), 0.5 * CELL) / far[row, column]
        cells = cells_at(grid, eyes[row] + shares[:, None] * away[row, column])
        cells = cells[has_cells(grid, cells)]
        seen[row, column] = not (grid.cells[cells[:, 0], cells[:, 1]] > 0).any()
    return seen
