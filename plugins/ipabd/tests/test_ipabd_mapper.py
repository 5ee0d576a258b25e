"""The adapter: messages in, one MapUpdate out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from navloom import Context, InputError, MapperInput, MapUpdate, Pose2D, PoseTrack, Registry, RobotSpec, Sweep
from navloom_ipabd import navloom_register, raster
from navloom_ipabd.adapter import Ipabd, Union
from navloom_ipabd.params import IpabdParams
from pydantic import ValidationError

SWEEP_NS = round(93 * 0.0133 * 1e9)


def make(height: float = 1.2, start: tuple[float, float] = (0.0, 0.0), **params: object) -> Ipabd:
    corners = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = RobotSpec(corners, height, 0.05, 0.3, 0.5, np.radians(25.0), 0.5, 1.0)
    stream = np.random.default_rng
    context = Context("main", 0.05, robot, lambda name: stream(len(name)), Pose2D(*start, np.pi / 2))
    return Ipabd(IpabdParams(**params), context)


def message_of(image, stamp_ns: int = 0, **changes: object) -> Sweep:
    values: dict = {
        "stamp_ns": stamp_ns,
        "request_id": 1,
        "ranges": image.ranges,
        "pitches": image.pitches,
        "frame_times": image.frame_times,
        "bearings": image.bearings,
        "geometry": image.geometry,
        "x": image.mount[0],
        "y": image.mount[1],
        "z": image.mount[2],
        "range_min": image.range_min,
        "range_max": image.range_max,
    }
    return Sweep(**(values | changes))


def track(*poses: tuple[float, float, float], until_ns: int = SWEEP_NS) -> PoseTrack:
    stamps = np.linspace(0, until_ns, len(poses)).astype(np.int64)
    return PoseTrack(stamps, np.array(poses, dtype=float).reshape(-1, 3))


AT_S = track((0.0, 0.0, np.pi / 2), (0.0, 0.0, np.pi / 2))


def on_lattice_of(wanted: MapUpdate, shown: MapUpdate) -> np.ndarray:
    """Cells of a map on the lattice of another one; unknown beyond its own extent."""
    size = wanted.grid.resolution
    right, up = (round((getattr(shown.grid.origin, axis) - getattr(wanted.grid.origin, axis)) / size) for axis in "xy")
    cells = np.full(wanted.grid.cells.shape, -1, np.int8)
    rows, columns = shown.grid.cells.shape
    cells[up : up + rows, right : right + columns] = shown.grid.cells
    return cells


def given(*sweeps: Sweep, poses: PoseTrack = AT_S, clear: bool = False) -> MapperInput:
    return MapperInput(stamp_ns=2_000_000_000, sweeps=sweeps, scans=(), track=poses, clear=clear)


def counts_of(update: MapUpdate) -> dict[str, int]:
    return {count.name: count.value for count in update.counts}


@pytest.fixture(scope="module")
def sweep(paper_sweep) -> Sweep:
    return message_of(paper_sweep.image)


def test_the_hook_registers_both_mappers() -> None:
    registry = Registry()
    navloom_register(registry)
    assert registry.roles == {("mapper", "ipabd"): Ipabd, ("mapper", "union"): Union}


def test_a_sweep_gives_a_map(sweep) -> None:
    update = make().update(given(sweep))
    counts = counts_of(update)
    assert sum(counts.values()) == 9494
    assert (counts["no_return"], counts["kept"]) == (1801, 101)
    assert update.stamp_ns == SWEEP_NS
    assert update.grid.resolution == 0.4
    assert update.segments.shape[1] == 4
    assert set(np.unique(update.grid.cells)) == {-1, 0, 100}


def test_the_start_is_a_cell_centre(sweep) -> None:
    grid = make(start=(0.13, -0.07)).update(given(sweep)).grid
    lattice = (np.array([0.13, -0.07]) - [grid.origin.x, grid.origin.y]) / 0.4
    assert lattice % 1.0 == pytest.approx([0.5, 0.5])


def test_z_limit_is_the_robots_height_unless_given(sweep) -> None:
    low, tall = counts_of(make().update(given(sweep))), counts_of(make(height=1.5).update(given(sweep)))
    assert tall["too_high"] < low["too_high"]
    assert counts_of(make(height=1.5, z_limit=1.2).update(given(sweep))) == low


def test_the_printed_order_gives_no_segments(sweep) -> None:
    update = make(filter_order="paper").update(given(sweep))
    assert update.segments.shape == (0, 4)
    assert counts_of(update)["kept"] == 0
    assert sum(counts_of(update).values()) == 9494


def test_geometry_may_overrule_the_sweep(paper_sweep, sweep) -> None:
    named = make(geometry="rigid_pitch").update(given(sweep))
    said = make().update(given(message_of(paper_sweep.image, geometry="rigid_pitch")))
    assert named.segments.tolist() == said.segments.tolist()
    assert named.segments.tolist() != make().update(given(sweep)).segments.tolist()


def test_without_a_new_sweep_there_is_no_map(sweep) -> None:
    mapper = make()
    mapper.update(given(sweep))
    assert mapper.update(given()) is None


def test_the_map_accumulates_and_after_clear_a_sweep_is_believed_where_it_looked(make_sweep, sweep) -> None:
    poses = np.tile([0.0, 3.0, 0.0], (94, 1))  # from (0, 3), facing +x: the right wall
    other = message_of(make_sweep(poses=poses).image)
    there = track((0.0, 3.0, 0.0), (0.0, 3.0, 0.0))
    alone = make().update(given(other, poses=there))
    mapper = make()
    first = mapper.update(given(sweep))
    both = mapper.update(given(other, poses=there))
    assert len(both.segments) > max(len(first.segments), len(alone.segments))
    assert (both.grid.cells == 100).sum() > (first.grid.cells == 100).sum()
    assert mapper.update(given(clear=True)) is None
    cleared = mapper.update(given(other, poses=there))
    seen, before, now = (on_lattice_of(both, one) for one in (alone, both, cleared))
    assert (seen != -1).sum() > 100 and ((seen == -1) & (before == 100)).sum() > 10
    assert now.tolist() == np.where(seen == -1, before, seen).tolist()
    assert cleared.segments[-len(alone.segments) :].tolist() == alone.segments.tolist()
    again = mapper.update(given(sweep))
    assert (on_lattice_of(both, again) == 100).sum() >= (now == 100).sum()  # the map accumulates as before


def test_without_accumulation_the_latest_sweep_is_the_map(make_sweep, sweep) -> None:
    other = message_of(make_sweep(poses=np.tile([0.0, 3.0, 0.0], (94, 1))).image)
    there = track((0.0, 3.0, 0.0), (0.0, 3.0, 0.0))
    mapper = make(accumulate=False)
    mapper.update(given(sweep))
    assert mapper.update(given(other, poses=there)).segments.tolist() == (
        make().update(given(other, poses=there)).segments.tolist()
    )


def test_the_same_scene_again_adds_no_segments(sweep) -> None:
    mapper = make()
    once = mapper.update(given(sweep))
    twice = mapper.update(given(sweep, sweep))
    assert twice.segments.tolist() == once.segments.tolist()
    assert sum(counts_of(twice).values()) == 2 * 9494


def test_a_clear_removes_a_phantom_and_keeps_what_is_out_of_view(make_sweep, sweep) -> None:
    mapper = make()
    clean = mapper.update(given(sweep))
    phantom = np.array([[0.0, 2.0, 0.4, 2.0], [0.0, -3.0, 1.0, -3.0]])  # before the robot and behind it
    known = mapper._known
    cells = known.cells.copy()
    raster.mark_occupied(cells, known.lattice, phantom[:1])
    mapper._known = replace(known, cells=cells, segments=np.concatenate([known.segments, phantom]))
    kept = mapper.update(given(sweep))
    assert phantom[0].tolist() in kept.segments.tolist()
    mapper.update(given(clear=True))
    cleared = mapper.update(given(sweep))
    assert cleared.segments[0].tolist() == phantom[1].tolist()
    assert cleared.segments[1:].tolist() == clean.segments.tolist()
    assert cleared.grid.cells.tolist() == clean.grid.cells.tolist()


def test_reset_forgets(sweep) -> None:
    mapper = make()
    mapper.update(given(sweep))
    mapper.reset()
    again = mapper.update(given(sweep))
    assert again.segments.tolist() == make().update(given(sweep)).segments.tolist()


def test_the_extent_may_be_given(sweep) -> None:
    grid = make(extent=(-2.0, 0.0, 2.0, 9.0)).update(given(sweep)).grid
    assert grid.cells.shape == (24, 11)  # y -0.2 .. 9.4, x -2.2 .. 2.2
    assert (grid.origin.x, grid.origin.y) == pytest.approx((-2.2, -0.2))


def test_bad_data_is_an_input_error_and_leaves_the_map(sweep, paper_sweep) -> None:
    mapper = make()
    before = mapper.update(given(sweep))
    falling = message_of(paper_sweep.image, bearings=paper_sweep.image.bearings[::-1].copy())
    with pytest.raises(InputError, match=r"ipabd: sweep\.bearings: got bearings that do not rise"):
        mapper.update(given(falling))
    with pytest.raises(InputError, match=r"ipabd: track\.stamps_ns: got a track from 0\.000 to 0\.500 s"):
        mapper.update(given(sweep, poses=track((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), until_ns=500_000_000)))
    empty = message_of(paper_sweep.image, ranges=np.zeros((0, 101)), pitches=np.zeros(0), frame_times=np.zeros(0))
    with pytest.raises(InputError, match=r"sweep\.ranges: got shape \(0, 101\)"):
        mapper.update(given(empty))
    assert mapper.update(given(sweep)).segments.tolist() == before.segments.tolist()


def test_a_map_too_large_for_its_cells_is_an_input_error(sweep) -> None:
    with pytest.raises(InputError, match=r"ipabd: map\.extent, resolution: got \d+ × \d+ cells of 0\.001 m"):
        make(cell=0.001).update(given(sweep))


def test_an_incidence_below_the_bearing_step_is_an_input_error(sweep) -> None:
    with pytest.raises(InputError, match=r"ipabd: segmentation\.incidence: got 0\.5° with a bearing step of 1°"):
        make(incidence_deg=0.5).update(given(sweep))


def test_nothing_compiles_after_warm_up(sweep, paper_sweep) -> None:
    from navloom_ipabd import lines, pressure, raster
    from navloom_ipabd import track as poses

    kernels = [
        pressure._press_columns,
        pressure._press_bins,
        lines._extract,
        raster._stamp_segments,
        raster._stamp_seen,
        poses.interpolate,
    ]
    Ipabd.warm_up()
    before = [len(kernel.signatures) for kernel in kernels]
    moving = track((0.0, 0.0, 1.5), (0.1, 0.3, 1.6))
    for mapper in (make(), make(raster="supercover"), make(filter_order="paper"), make(bin_width_deg=1.5)):
        mapper.update(given(sweep))
        mapper.update(given(message_of(paper_sweep.image, geometry="rigid_pitch"), poses=moving))
    assert [len(kernel.signatures) for kernel in kernels] == before == [1] * 6


@pytest.mark.parametrize("params", [{"cell": 0.0}, {"cel": 0.4}, {"incidence_deg": 95.0}, {"raster": "slope"}])
def test_wrong_parameters_are_refused(params: dict) -> None:
    with pytest.raises(ValidationError):
        IpabdParams(**params)
