"""A real sweep of a pitched SICK LMS in a corridor (3DTK), found through NAVLOOM_DATA.

The file gives ranges, pitches and beams, but neither the height of the floor nor the zero of the pitch; both come from
the data. Heights are relative to the sensor. In the histogram of heights of points up to 0.8 m to the sides, the
highest bin below -0.2 m is the floor, but rings at 0.25, 0.5, … m ahead have it from -0.37 to -0.52 m: the floor seems
to fall. A line through the highest bins of the rings, with equal weights, gives the height under the sensor and the
slope; the slope is the zero offset of the pitch. The ceiling, which was not used, is level after the correction. The
floor is not quite: its heights step by 0.06 m near 1.1 m and scatter to 0.09 m beyond 2 m, as if the recorded pitch
jumped by a degree or two. The middle of every ring stays within 0.04 m of zero; the floor's tolerance is 0.12 m here.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from navloom_ipabd.mapping import MapSettings, draw, outline
from navloom_ipabd.pressure_numpy import points_in_reference, press_numpy, union
from navloom_ipabd.projection import project
from navloom_ipabd.rules import Filters, Rule
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import standing

FILTERS = Filters(floor_tolerance=0.12, z_limit=1.5, min_range=0.3)  # the ceiling is at 2.4 m
HERE = (0.0, 0.0, math.pi / 2)  # forward is +y
RANGE_MAX = 32.767  # the largest number of the sensor, mm in 15 bits


@pytest.fixture(scope="module")
def recording() -> dict[str, np.ndarray]:
    folder = os.environ.get("NAVLOOM_DATA")
    if not folder:
        pytest.skip("NAVLOOM_DATA is not set")
    path = Path(folder) / "scan3d" / "pitching_lms200_0.npz"
    if not path.exists():
        pytest.skip(f"{path.name} is not in NAVLOOM_DATA")
    with np.load(path) as data:
        return {name: data[name] for name in ("ranges_m", "pitch_deg", "beam_deg")}


def image_of(recording: dict[str, np.ndarray], pitch_offset: float, height: float) -> SweepImage:
    frames = recording["pitch_deg"].size
    return SweepImage(
        recording["ranges_m"],
        np.radians(recording["pitch_deg"].astype(float)) + pitch_offset,
        0.0133 * np.arange(frames),
        np.radians(-recording["beam_deg"].astype(float)),  # the file counts beams to the right
        (0.0, 0.0, height),
        0.0,
        RANGE_MAX,
        "rigid_pitch",
    )


def find_floor(recording: dict[str, np.ndarray]) -> tuple[float, float]:
    """Offset of the pitch, rad, and height of the sensor, m, as described at the top of this file."""
    image = image_of(recording, 0.0, 0.0)
    points = project(image)[(image.ranges > 0.3) & (image.ranges < 32.0)]
    x, z = points[np.abs(points[:, 1]) < 0.8][:, [0, 2]].T
    rings, modes = np.arange(0.25, 3.5, 0.25), []
    for ring in rings:
        numbers, edges = np.histogram(z[(x >= ring) & (x < ring + 0.25)], bins=np.arange(-1.0, -0.2, 0.01))
        modes.append(edges[numbers.argmax()] + 0.005)
    slope, under = np.polyfit(rings + 0.125, modes, 1)
    return math.atan(-slope), -float(under)


@pytest.fixture(scope="module")
def corridor(recording) -> SweepImage:
    return image_of(recording, *find_floor(recording))


def test_the_floor_is_found(recording) -> None:
    offset, height = find_floor(recording)
    assert math.degrees(offset) == pytest.approx(2.55, abs=0.05)
    assert height == pytest.approx(0.388, abs=0.005)


def test_the_ceiling_is_level_after_the_correction(corridor) -> None:
    points = points_in_reference(corridor)[(corridor.ranges > 0.3) & (corridor.ranges < 32.0)]
    layer = points[np.abs(points[:, 2] - 2.44) < 0.1]
    assert len(layer) > 8000
    assert abs(math.degrees(math.atan(np.polyfit(layer[:, 0], layer[:, 2], 1)[0]))) < 0.1


def test_the_floor_lies_within_its_tolerance_everywhere(corridor) -> None:
    points = points_in_reference(corridor)[(corridor.ranges > 0.3) & (corridor.ranges < 32.0)]
    layer = points[np.abs(points[:, 2]) < 0.1]
    for ring in np.arange(0.25, 3.5, 0.25):
        assert abs(np.median(layer[(layer[:, 0] >= ring) & (layer[:, 0] < ring + 0.25), 2])) < 0.04


def test_counts_sum_to_the_points_and_outliers_are_rejected(corridor) -> None:
    counts = outline(corridor, standing(226, HERE), MapSettings(filters=FILTERS)).barriers.counts
    assert sum(counts.values()) == corridor.ranges.size == 226 * 360
    assert counts[Rule.BEYOND_MAX] == (corridor.ranges >= RANGE_MAX - 0.05).sum() == 1481
    assert counts[Rule.BELOW_MIN] == (corridor.ranges < 0.3).sum() == 1973
    assert counts[Rule.FLOOR] > 15_000
    assert counts[Rule.KEPT] > 340  # of 361 half degrees


def test_fused_equals_numpy_on_real_data(corridor) -> None:
    shown = outline(corridor, standing(226, HERE), MapSettings(filters=FILTERS)).barriers
    plain = press_numpy(corridor, FILTERS)
    assert shown.counts == plain.counts
    np.testing.assert_allclose(shown.ranges, plain.ranges, rtol=0.0, atol=1e-12)


def test_no_floor_and_no_outlier_is_left_in_the_union(corridor) -> None:
    left = union(corridor, FILTERS)
    assert left[:, 2].min() > 0.12
    assert left[:, 2].max() <= 1.5
    assert np.linalg.norm(left - [0.0, 0.0, corridor.mount[2]], axis=1).max() < RANGE_MAX - 0.05


def test_the_walls_of_the_corridor(corridor) -> None:
    """Both walls are found over more than 2.5 m, along the corridor to 5°, 1.9 m apart, and 8 m are free between."""
    settings = MapSettings(filters=FILTERS, resolution=0.05)
    shown = outline(corridor, standing(226, HERE), settings)
    grid = draw(shown, settings)
    along = shown.segments[:, 2:] - shown.segments[:, :2]
    lengths, middles = np.hypot(*along.T), 0.5 * (shown.segments[:, 0] + shown.segments[:, 2])
    is_wall = (lengths > 1.0) & (shown.segments[:, [1, 3]].max(axis=1) < 6.0)
    assert np.degrees(np.arctan(np.abs(along[is_wall, 0] / along[is_wall, 1]))).max() < 5.0
    left, right = is_wall & (middles < 0.0), is_wall & (middles > 0.0)
    assert lengths[left].sum() > 2.5
    assert lengths[right].sum() > 2.5
    left_x, right_x = middles[left].mean(), middles[right].mean()
    assert right_x - left_x == pytest.approx(1.9, abs=0.05)
    column = round(0.5 * (left_x + right_x) / 0.05) - grid.lattice.column
    assert (grid.cells[-grid.lattice.row : -grid.lattice.row + 160, column] == 0).all()
