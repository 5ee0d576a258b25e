"""The adapter: range scans in, one MapUpdate out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Context, InputError, MapperInput, MapUpdate, Pose2D, PoseTrack, RangeScan, Registry, RobotSpec
from navloom_scan_grid import kernels, navloom_register
from navloom_scan_grid.adapter import Layered, ScanGrid
from navloom_scan_grid.params import ScanGridParams
from pydantic import ValidationError

TICK_NS = 50_000_000
BEARINGS = np.radians(np.linspace(-90.0, 90.0, 181))


def make(start: tuple[float, float] = (0.0, 0.0), **params: object) -> ScanGrid:
    corners = np.array([[0.25, 0.2], [-0.25, 0.2], [-0.25, -0.2], [0.25, -0.2]])
    robot = RobotSpec(corners, 0.6, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)
    return ScanGrid(ScanGridParams(**params), Context("main", 0.05, robot, np.random.default_rng, Pose2D(*start, 0.0)))


def scan(tick: int, ranges: object = 2.0, half_angle: float = 0.0) -> RangeScan:
    n = BEARINGS.size
    values = np.broadcast_to(np.asarray(ranges, dtype=float), n).copy()
    return RangeScan(TICK_NS * tick, np.zeros((n, 2)), BEARINGS, np.full(n, half_angle), np.zeros(n), values, 0.05, 8.0)


def standing(ticks: int, x: float = 0.0) -> PoseTrack:
    return PoseTrack(TICK_NS * np.arange(ticks + 1), np.tile([x, 0.0, 0.0], (ticks + 1, 1)))


def given(tick: int, *scans: RangeScan, clear: bool = False, x: float = 0.0) -> MapperInput:
    return MapperInput(TICK_NS * tick, (), scans, standing(tick, x), clear)


def cell(update: MapUpdate, x: float, y: float) -> int:
    grid = update.grid
    row, column = int((y - grid.origin.y) // grid.resolution), int((x - grid.origin.x) // grid.resolution)
    return int(grid.cells[row, column])


def counts(update: MapUpdate) -> dict[str, int]:
    return {count.name: count.value for count in update.counts}


def test_the_hook_registers_both_mappers() -> None:
    registry = Registry()
    navloom_register(registry)
    assert registry.roles == {("mapper", "scan_grid"): ScanGrid, ("mapper", "layered"): Layered}
    assert ScanGrid.accepts == (RangeScan,)


def test_a_scan_gives_a_map() -> None:
    """A half circle of 2 m: free within, occupied on it, unknown behind it and behind the robot."""
    update = make().update(given(0, scan(0)))
    assert [cell(update, x, 0.01) for x in (0.01, 1.0, 2.02, 2.3, -1.0)] == [0, 0, 100, -1, -1]
    assert update.segments.shape == (0, 4)
    assert (update.grid.resolution, update.stamp_ns) == (0.05, 0)
    assert counts(update) == {"echo": 181, "at_min": 0, "beyond": 0, "no_echo": 0}


def test_cell_values_in_percent_show_the_certainty() -> None:
    update = make(levels="percent", p_hit=0.7, p_passed=0.4).update(given(0, scan(0)))
    assert [cell(update, x, 0.01) for x in (1.0, 2.02, 2.3)] == [40, 70, -1]


def test_counts_are_of_the_readings_since_the_last_map() -> None:
    mapper = make(max_range=5.0)
    mapper.update(given(0, scan(0)))
    mixed = np.full(181, 2.0)
    mixed[:4] = [math.inf, 7.995, 6.0, 0.05]
    assert mapper.update(given(1, scan(1, mixed))) is None
    update = mapper.update(given(10, scan(10, 3.0)))
    assert counts(update) == {"echo": 177 + 181, "at_min": 1, "beyond": 1, "no_echo": 2}


def test_it_is_published_at_most_at_its_rate() -> None:
    """Scans of 0.05 s whose ranges change every tick: at 0, 0.5, 1.0 and 1.5 s."""
    mapper = make(publish_rate_hz=2.0)
    said = [tick for tick in range(40) if mapper.update(given(tick, scan(tick, 2.0 + 0.1 * tick)))]
    assert said == [0, 10, 20, 30]


def test_it_is_published_only_when_it_changed() -> None:
    """The robot is stopped before a static wall: the map settles with the first scan."""
    mapper = make()
    assert [tick for tick in range(60) if mapper.update(given(tick, scan(tick)))] == [0]
    assert mapper.update(given(60, scan(60, 3.0))) is not None


def test_a_removed_obstacle_is_forgotten_and_a_new_one_appears_at_once() -> None:
    """From log(0.97 / 0.03) = 3.48 at -0.405 a scan, below log(0.65 / 0.35) = 0.62 after 8."""
    mapper = make(publish_rate_hz=20.0)
    for tick in range(100):
        mapper.update(given(tick, scan(tick)))
    maps = {tick: mapper.update(given(tick, scan(tick, 3.0))) for tick in range(100, 120)}
    gone = [tick for tick, update in maps.items() if update is not None and cell(update, 2.02, 0.01) == 0]
    assert gone[0] == 107
    appeared = [mapper.update(given(tick, scan(tick, 1.0))) for tick in range(120, 125)]
    seen = [update for update in appeared if update is not None and cell(update, 1.02, 0.01) == 100]
    assert seen and seen[0].stamp_ns <= 123 * TICK_NS


def test_a_clear_empties_the_map_and_is_answered_at_once() -> None:
    mapper = make()
    mapper.update(given(0, scan(0)))
    fresh = mapper.update(given(1, scan(1, 3.0), clear=True))
    alone = make().update(given(1, scan(1, 3.0)))
    assert fresh.grid.cells.tolist() == alone.grid.cells.tolist()
    empty = mapper.update(given(2, clear=True))
    assert set(empty.grid.cells.ravel()) == {-1}
    assert empty.stamp_ns == 2 * TICK_NS


def test_a_clear_with_a_radius_empties_only_cells_within_it() -> None:
    mapper = make(clear_radius=1.0)
    mapper.update(given(0, scan(0)))
    cleared = mapper.update(given(1, clear=True))
    assert [cell(cleared, x, 0.01) for x in (0.5, 0.9, 1.5, 2.02)] == [-1, -1, 0, 100]
    assert mapper.update(given(2, clear=True)) is not None  # the goal waits for a map, changed or not


def test_reset_forgets() -> None:
    mapper = make()
    mapper.update(given(0, scan(0)))
    mapper.reset()
    again = mapper.update(given(1, scan(1, 3.0)))
    assert again.grid.cells.tolist() == make().update(given(1, scan(1, 3.0))).grid.cells.tolist()


def test_without_scans_no_map_is_published() -> None:
    assert make().update(given(0)) is None


def test_the_map_grows_in_chunks_and_its_cells_stay_where_they_are() -> None:
    mapper = make(chunk=1.0, publish_rate_hz=20.0)
    before = mapper.update(given(0, scan(0)))
    after = mapper.update(given(1, scan(1), x=6.5))
    assert (before.grid.origin.x, before.grid.origin.y) == (0.0, -3.0)
    assert before.grid.cells.shape == (120, 60)
    assert after.grid.cells.shape == (120, 180)  # to 8.5 m, and one cell's depth of a cone
    assert cell(after, 2.02, 0.01) == cell(before, 2.02, 0.01) == 100
    assert after.grid.origin == before.grid.origin


def test_an_extent_is_covered_from_the_start() -> None:
    update = make(extent=(-6.0, -1.0, 12.0, 20.0)).update(given(0, scan(0)))
    grid = update.grid
    assert (grid.origin.x, grid.origin.y) == (-10.0, -5.0)  # whole chunks of 5 m
    assert grid.cells.shape == (600, 500)


def test_the_robots_place_is_covered_before_anything_was_seen() -> None:
    update = make(start=(-7.0, 3.0)).update(given(0, clear=True))
    assert cell(update, -7.0, 3.0) == -1


def test_scans_that_no_pose_covers_are_an_input_error_and_leave_the_map() -> None:
    mapper = make(publish_rate_hz=20.0)
    before = mapper.update(given(0, scan(0)))
    with pytest.raises(InputError, match=r"scan_grid: track\.stamps_ns: got a track from"):
        mapper.update(given(1, scan(50)))
    with pytest.raises(InputError, match=r"scan_grid: track: got 0 stamps"):
        empty = PoseTrack(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
        mapper.update(MapperInput(TICK_NS, (), (scan(1),), empty))
    after = mapper.update(given(2, scan(2, 2.3)))
    assert before.grid.cells.shape == after.grid.cells.shape
    assert cell(after, 1.0, 0.01) == 0


def test_an_empty_scan_changes_nothing() -> None:
    none = np.zeros(0)
    empty = RangeScan(0, np.zeros((0, 2)), none, none, none, none, 0.05, 8.0)
    update = make().update(given(0, empty))
    assert set(update.grid.cells.ravel()) == {-1}
    assert sum(counts(update).values()) == 0


def test_nothing_compiles_after_warm_up() -> None:
    compiled = [kernels.place, kernels.insert, kernels.render]
    ScanGrid.warm_up()
    before = [len(kernel.signatures) for kernel in compiled]
    for mapper in (make(), make(levels="percent"), make(no_echo_clears=False)):
        mapper.update(given(0, scan(0, math.inf), scan(0, 2.0, half_angle=0.26)))
        mapper.update(given(30, scan(30, 7.0), x=3.0))
    assert [len(kernel.signatures) for kernel in compiled] == before == [1] * 3


@pytest.mark.parametrize(
    "params",
    [{"cell": 0.0}, {"cel": 0.1}, {"p_hit": 0.4}, {"extent": (1.0, 0.0, 0.0, 0.0)}, {"occupied_from": 0.98}],
    ids=["cell", "unknown key", "p_hit", "extent", "occupied_from"],
)
def test_wrong_parameters_are_refused(params: dict) -> None:
    with pytest.raises(ValidationError):
        ScanGridParams(**params)
