"""Small scenes: posts, walls, a robot and its target. What a sensor sees of them is exact."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from navloom.geometry.footprints import rectangle
from navloom.geometry.frames import transform
from navloom.geometry.world import Place
from navloom.messages import OccupancyGrid, Pose2D
from numpy.typing import NDArray

__all__ = [
    "ALL_ROUND",
    "CELL",
    "MAST",
    "SONARS",
    "TWO_LASERS",
    "WIDE_SONARS",
    "Mount",
    "Post",
    "Scene",
    "Wall",
    "grid_of",
]

Floats = NDArray[np.float64]

CELL = 0.05
"""Edge of a cell of the maps, m."""

FEW = 5
"""Most posts, and most walls, that the description of a scene lists."""


@dataclass(frozen=True)
class Post:
    """A disc: centre and radius, m, map frame."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class Wall:
    """A straight wall without thickness: its ends, m, map frame."""

    x1: float
    y1: float
    x2: float
    y2: float


@dataclass(frozen=True)
class Mount:
    """A laser, or a ring of sonars, on the robot.

    Attributes:
        name: Name of the sensor.
        x, y: Its place, m, base frame; for a ring the middle.
        middle: Bearing of its middle beam, rad.
        half_field: Half its field of view, rad.
        beams: Number of its beams over a full turn.
        half_angle: Half the opening of a beam, rad; 0 for a laser.
        rim: Radius of the ring on which its beams begin, m.
        reach: Its greatest range, m.
    """

    name: str
    x: float
    y: float
    middle: float
    half_field: float
    beams: int = 120
    half_angle: float = 0.0
    rim: float = 0.0
    reach: float = 6.0


ALL_ROUND = (Mount("laser", 0.0, 0.0, 0.0, math.pi),)
TWO_LASERS = (Mount("rear", -0.2, 0.0, math.pi, 2.0), Mount("front", 0.2, 0.0, 0.0, 2.0))
"""Two lasers, neither in the middle of the robot nor with a view all round."""
MAST = (Mount("mast", -0.25, 0.15, 0.0, math.pi),)
"""One laser with a view all round, behind the middle of the robot and beside it."""
SONARS = (Mount("sonars", 0.0, 0.0, 0.0, math.pi, 16, math.radians(15.0), 0.1, 4.0),)
"""A ring of sonars all round, whose cones overlap, and nothing else."""
SHORT_SONARS = (replace(SONARS[0], reach=1.0),)
WIDE_SONARS = (Mount("sonars", 0.0, 0.0, 0.0, math.pi, 5, math.radians(40.0), 0.1, 4.0),)
"""Five sonars with wide cones: each is needed, and an echo may lie far from its axis."""


@dataclass(frozen=True)
class Scene:
    """A robot, its target and obstacles, in the map frame.

    Attributes:
        start: Pose of the robot at the start.
        target: Where the robot must go: x, y, m.
        posts, walls: The obstacles.
        length, width: Size of the robot's footprint, m.
        way: Corners of a way to follow, m; empty if there is none.
        lasers: Lasers on the robot, or its ring of sonars.
        map_heading: Heading of the raster of the map in the map frame, rad.
        has_earlier_map: A planner first gets a request on another map of the same size.
        backs: The robot drives backwards.
        came: Distance that the robot drove straight ahead to its start, m; 0 where it does not matter.
    """

    start: Place
    target: tuple[float, float]
    posts: tuple[Post, ...] = ()
    walls: tuple[Wall, ...] = ()
    length: float = 0.5
    width: float = 0.4
    way: tuple[tuple[float, float], ...] = ()
    lasers: tuple[Mount, ...] = ALL_ROUND
    map_heading: float = 0.0
    has_earlier_map: bool = False
    backs: bool = False
    came: float = 0.0

    @property
    def outline(self) -> Floats:
        """(4, 2) corners of the footprint, m, base frame."""
        return rectangle(self.length, self.width)

    @property
    def words(self) -> str:
        """The scene as one phrase."""
        s = self.start
        parts = [
            f"robot of {self.length:g} m x {self.width:g} m at {_at(s.x, s.y)} heading {math.degrees(s.heading):.0f}°"
        ]
        parts.append(f"way of {len(self.way)} corners" if self.way else f"target {_at(*self.target)}")
        parts += [f"post of {p.radius:.2g} m at {_at(p.x, p.y)}" for p in self.posts[:FEW]]
        parts += [f"wall from {_at(w.x1, w.y1)} to {_at(w.x2, w.y2)}" for w in self.walls[:FEW]]
        if self.backs:
            parts.append("driving backwards")
        if self.came:
            parts.append(f"after {self.came:g} m straight ahead")
        if self.lasers[0].half_angle:
            parts.append(f"a ring of {self.lasers[0].beams} sonars of {self.lasers[0].reach:g} m")
        elif self.lasers is not ALL_ROUND:
            parts.append("lasers at " + " and ".join(f"({laser.x:g}, {laser.y:g})" for laser in self.lasers))
        if self.map_heading:
            parts.append(f"raster turned by {math.degrees(self.map_heading):.0f}°")
        if self.has_earlier_map:
            parts.append("after a request on the mirrored map")
        more = max(0, len(self.posts) - FEW) + max(0, len(self.walls) - FEW)
        return ", ".join(parts) + (f" and {more} more obstacles" if more else "")

    def moved(self, place: Place) -> Scene:
        """The scene turned about the origin by a heading and then moved."""
        to_map = np.array([place.x, place.y, place.heading])

        def at(x: float, y: float) -> tuple[float, float]:
            new_x, new_y = transform(to_map, np.array([x, y])).tolist()
            return new_x, new_y

        heading = math.remainder(self.start.heading + place.heading, math.tau)
        return replace(
            self,
            start=Place(*at(self.start.x, self.start.y), heading),
            target=at(*self.target),
            posts=tuple(Post(*at(p.x, p.y), p.radius) for p in self.posts),
            walls=tuple(Wall(*at(w.x1, w.y1), *at(w.x2, w.y2)) for w in self.walls),
            way=tuple(at(x, y) for x, y in self.way),
        )

    def mirrored(self) -> Scene:
        """The scene mirrored at the x axis: left becomes right."""
        return replace(
            self,
            start=Place(self.start.x, -self.start.y, -self.start.heading),
            target=(self.target[0], -self.target[1]),
            posts=tuple(Post(p.x, -p.y, p.radius) for p in self.posts),
            walls=tuple(Wall(w.x1, -w.y1, w.x2, -w.y2) for w in self.walls),
            way=tuple((x, -y) for x, y in self.way),
        )

    def smaller(self) -> Iterator[Scene]:
        """Scenes with fewer posts or walls: first with half of them, then with one less."""
        for name in ("posts", "walls"):
            kept = getattr(self, name)
            half = len(kept) // 2
            parts = [kept[:half], kept[half:]] if half else []
            for part in (*parts, *(kept[:k] + kept[k + 1 :] for k in range(len(kept)))):
                yield replace(self, **{name: part})

    def ranges(self, origin: tuple[float, float], directions: Floats, reach: float) -> Floats:
        """(n,) distance to the first obstacle in each direction, m; +inf if there is none within reach.

        Args:
            origin: Place of the sensor, m, map frame.
            directions: (n,) rad, map frame.
            reach: Longest distance, m.
        """
        x, y = origin
        cos, sin = np.cos(directions), np.sin(directions)
        nearest = np.full(len(directions), np.inf)
        for post in self.posts:
            along = cos * (post.x - x) + sin * (post.y - y)
            off = cos * (post.y - y) - sin * (post.x - x)
            with np.errstate(invalid="ignore"):
                hit = along - np.sqrt(post.radius**2 - off**2)
            nearest = np.where(hit >= 0.0, np.minimum(nearest, hit), nearest)
        for wall in self.walls:
            ux, uy = wall.x2 - wall.x1, wall.y2 - wall.y1
            wx, wy = wall.x1 - x, wall.y1 - y
            across = cos * uy - sin * ux
            with np.errstate(divide="ignore", invalid="ignore"):
                hit = (wx * uy - wy * ux) / across
                share = (wx * sin - wy * cos) / across
            there = (hit >= 0.0) & (share >= 0.0) & (share <= 1.0)
            nearest = np.where(there, np.minimum(nearest, hit), nearest)
        return np.where(nearest <= reach, nearest, np.inf)

    def gap(self, x: float, y: float, heading: float) -> float:
        """Distance of the footprint, at a pose, from the nearest obstacle, m; 0 in contact, +inf without obstacles."""
        outline = transform(np.array([x, y, heading]), self.outline)
        gaps = [max(0.0, _to_polygon(outline, p.x, p.y) - p.radius) for p in self.posts]
        gaps += [_wall_gap(outline, w) for w in self.walls]
        return min(gaps, default=math.inf)

    def cells(self, resolution: float, margin: float = 1.0) -> tuple[NDArray[np.bool_], tuple[float, float]]:
        """The scene as a raster: (rows, cols) which cells are occupied, and the lower left corner, m, map frame."""
        ends = [(self.start.x, self.start.y), self.target, *self.way]
        ends += [(p.x + s * p.radius, p.y + s * p.radius) for p in self.posts for s in (-1.0, 1.0)]
        ends += [(w.x1, w.y1) for w in self.walls] + [(w.x2, w.y2) for w in self.walls]
        low = np.floor((np.min(ends, axis=0) - margin) / resolution) * resolution
        cols, rows = np.ceil((np.max(ends, axis=0) + margin - low) / resolution).astype(int).tolist()
        x = low[0] + (np.arange(cols) + 0.5) * resolution
        y = (low[1] + (np.arange(rows) + 0.5) * resolution)[:, None]
        occupied = np.zeros((rows, cols), dtype=np.bool_)
        for p in self.posts:
            occupied |= np.hypot(x - p.x, y - p.y) <= p.radius
        for w in self.walls:
            occupied |= _segment_field(x, y, w) <= 0.51 * resolution
        return occupied, (float(low[0]), float(low[1]))


def grid_of(scene: Scene, place: Place | None = None) -> OccupancyGrid:
    """The map of a scene; a place turns and moves it as a whole."""
    occupied, (x, y) = scene.cells(CELL)
    at = Place(0.0, 0.0) if place is None else place
    left, low = transform(np.array([at.x, at.y, at.heading]), np.array([x, y])).tolist()
    heading = math.remainder(at.heading, math.tau)
    return OccupancyGrid(np.where(occupied, 100, 0).astype(np.int8), CELL, Pose2D(left, low, heading))


def _at(x: float, y: float) -> str:
    return f"({x:.2f}, {y:.2f})"


def _segment_field(x: Floats, y: Floats, w: Wall) -> Floats:
    """Distance of each point of a raster from a wall, m."""
    ux, uy = w.x2 - w.x1, w.y2 - w.y1
    share = np.clip(((x - w.x1) * ux + (y - w.y1) * uy) / max(ux * ux + uy * uy, 1e-12), 0.0, 1.0)
    field: Floats = np.hypot(x - w.x1 - share * ux, y - w.y1 - share * uy)
    return field


def _to_segment(x: float, y: float, x1: float, y1: float, x2: float, y2: float) -> float:
    ux, uy = x2 - x1, y2 - y1
    share = min(1.0, max(0.0, ((x - x1) * ux + (y - y1) * uy) / max(ux * ux + uy * uy, 1e-12)))
    return math.hypot(x - x1 - share * ux, y - y1 - share * uy)


def _edges(outline: Floats) -> list[tuple[float, float, float, float]]:
    corners = [(float(x), float(y)) for x, y in outline]
    return [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]


def _to_polygon(outline: Floats, x: float, y: float) -> float:
    """Distance of a point from a convex polygon, counter-clockwise, m; 0 within it."""
    edges = _edges(outline)
    if all((x2 - x1) * (y - y1) - (y2 - y1) * (x - x1) >= 0.0 for x1, y1, x2, y2 in edges):
        return 0.0
    return min(_to_segment(x, y, *edge) for edge in edges)


def _wall_gap(outline: Floats, wall: Wall) -> float:
    """Distance of a wall from a convex polygon, m; 0 where they meet."""
    ends = (wall.x1, wall.y1), (wall.x2, wall.y2)
    if any(_cross(edge, (*ends[0], *ends[1])) for edge in _edges(outline)):
        return 0.0
    from_ends = min(_to_polygon(outline, *end) for end in ends)
    return min(from_ends, *(_to_segment(x, y, *ends[0], *ends[1]) for x, y in outline.tolist()))


def _cross(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    """Whether two segments cross each other."""

    def side(s: tuple[float, float, float, float], x: float, y: float) -> float:
        return (s[2] - s[0]) * (y - s[1]) - (s[3] - s[1]) * (x - s[0])

    return side(a, *b[:2]) * side(a, *b[2:]) < 0.0 and side(b, *a[:2]) * side(b, *a[2:]) < 0.0
