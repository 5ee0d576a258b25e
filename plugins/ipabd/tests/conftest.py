"""A small ray caster of the paper's world, independent of every plugin, and sweeps made with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from navloom_ipabd.sweep import SweepImage
from numpy.typing import NDArray

Floats = NDArray[np.float64]

WALL = (0.0, 2.4)
PAPER_BOXES = {  # DECISIONS section 8: x, y, z intervals, m; the robot stands at (0, 0) and faces +y
    "back wall": ((-4.6, 7.2), (9.2, 9.4), WALL),
    "left wall": ((-4.4, -4.2), (-1.0, 9.4), WALL),
    "right wall": ((6.8, 7.0), (-1.0, 9.4), WALL),
    "gate wall left": ((-4.4, -1.4), (5.2, 5.4), WALL),
    "girder A": ((-1.4, 1.0), (5.2, 5.4), (0.90, 1.10)),
    "post A/B": ((1.0, 1.4), (5.2, 5.4), WALL),
    "girder B": ((1.4, 3.8), (5.2, 5.4), (1.40, 1.60)),
    "partition": ((3.8, 4.2), (5.2, 6.8), WALL),
}
PITCHES = np.radians(-5.0 + 0.266 * np.arange(94))
BEARINGS = np.radians(np.arange(-50.0, 51.0))  # β 40..140°
FRAME_TIMES = 0.0133 * np.arange(94)
MOUNT_HEIGHT, RANGE_MAX = 0.4, 80.0


@dataclass(frozen=True, eq=False)
class CastSweep:
    """A sweep, and what each ray hit: the index of a box, -1 the floor, -2 nothing; (frames, beams)."""

    image: SweepImage
    hits: NDArray[np.int64]
    names: tuple[str, ...]

    def count(self, name: str) -> int:
        index = {"floor": -1, "none": -2}.get(name)
        return int((self.hits == (self.names.index(name) if index is None else index)).sum())


def directions_of(pitches: Floats, bearings: Floats, geometry: str) -> Floats:
    """(frames, beams, 3) unit vectors in base, x forward, y left, z up."""
    a, b = np.meshgrid(pitches, bearings, indexing="ij")
    if geometry == "paper":
        return np.stack([np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)], axis=-1)
    return np.stack([np.cos(b) * np.cos(a), np.sin(b), np.cos(b) * np.sin(a)], axis=-1)


def cast(origins: Floats, directions: Floats, boxes: list) -> tuple[Floats, NDArray[np.int64]]:
    """Slab method: range and index of what each ray meets first, the floor z = 0 included. All (..., 3), m, map."""
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(directions[..., 2] < 0.0, -origins[..., 2] / directions[..., 2], np.inf)
    best, hit = floor, np.where(np.isfinite(floor), -1, -2)
    for index, box in enumerate(boxes):
        enter, leave = np.zeros(best.shape), np.full(best.shape, np.inf)
        for axis, (low, high) in enumerate(box):
            o, d = origins[..., axis], directions[..., axis]
            with np.errstate(divide="ignore", invalid="ignore"):
                first, second = (low - o) / d, (high - o) / d
            inside = (o >= low) & (o <= high)
            near = np.where(d == 0.0, np.where(inside, -np.inf, np.inf), np.minimum(first, second))
            far = np.where(d == 0.0, np.where(inside, np.inf, -np.inf), np.maximum(first, second))
            enter, leave = np.maximum(enter, near), np.minimum(leave, far)
        meets = (enter <= leave) & (enter < best) & (enter > 0.0)
        best, hit = np.where(meets, enter, best), np.where(meets, index, hit)
    return best, hit


def sweep_world(
    boxes: dict | None = None,
    geometry: str = "paper",
    poses: Floats | None = None,
    bearings: Floats = BEARINGS,
    sigma: float = 0.0,
    rng: np.random.Generator | None = None,
    mount: tuple[float, float, float] = (0.0, 0.0, MOUNT_HEIGHT),
) -> CastSweep:
    """Sweep of a world from one pose per frame: (frames, 3) x, y, m, heading, rad, of base in the map frame."""
    boxes = PAPER_BOXES if boxes is None else boxes
    poses = np.tile([0.0, 0.0, np.pi / 2], (PITCHES.size, 1)) if poses is None else poses
    local = directions_of(PITCHES, bearings, geometry)
    c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    directions = np.stack(
        [c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1], local[..., 2]], axis=-1
    )
    x = poses[:, 0:1] + c * mount[0] - s * mount[1]
    y = poses[:, 1:2] + s * mount[0] + c * mount[1]
    origins = np.stack(np.broadcast_arrays(x, y, mount[2], local[..., 0])[:3], axis=-1)
    ranges, hits = cast(origins, directions, list(boxes.values()))
    if rng is not None:
        ranges = ranges + sigma * rng.standard_normal(ranges.shape)
    is_lost = ~(ranges <= RANGE_MAX)
    ranges, hits = np.where(is_lost, np.inf, ranges), np.where(is_lost, -2, hits)
    image = SweepImage(ranges, PITCHES, FRAME_TIMES, bearings, mount, 0.0, RANGE_MAX, geometry)
    return CastSweep(image, hits, tuple(boxes))


@pytest.fixture(scope="session")
def make_sweep() -> Callable[..., CastSweep]:
    """`sweep_world`, to sweep any boxes from any poses."""
    return sweep_world


@pytest.fixture(scope="session")
def paper_sweep() -> CastSweep:
    """The paper's world, noise-free, from S facing +y, by eq. (1)."""
    return sweep_world()


@pytest.fixture(scope="session")
def paper_boxes() -> dict:
    """The boxes of the paper's world."""
    return dict(PAPER_BOXES)


@pytest.fixture
def make_image() -> Callable[..., SweepImage]:
    """A sweep image from ranges; pitches and bearings default to level and 0, 1, 2, … degrees."""

    def make(ranges: object, pitches_deg: object = None, bearings_deg: object = None, **changes: object) -> SweepImage:
        table = np.atleast_2d(np.asarray(ranges, dtype=float))
        frames, beams = table.shape
        values: dict = {
            "ranges": table,
            "pitches": np.radians(np.zeros(frames) if pitches_deg is None else pitches_deg),
            "frame_times": 0.0133 * np.arange(frames),
            "bearings": np.radians(np.arange(float(beams)) if bearings_deg is None else bearings_deg),
            "mount": (0.0, 0.0, 0.4),
            "range_min": 0.0,
            "range_max": 80.0,
        }
        return SweepImage(**(values | changes))

    return make
