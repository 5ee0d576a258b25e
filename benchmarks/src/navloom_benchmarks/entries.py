"""The entries of `navloom bench` that need one process: the paper's loop, planning, ray casting and the codec.

Each is a generator of rows; `measuring` calls it with an effort and a function that shows progress.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import lockstep_of
from navloom.engine.plugin_factory import make_plugins
from navloom.geometry.footprints import rectangle
from navloom.geometry.world import Box
from navloom.messages import OccupancyGrid, Path, PlanRequest, Pose2D
from navloom.messages.codec import decode, encode, schema_label
from navloom.plugins import Discovery
from navloom.roles import Context, Planner, PlannerInput, RobotSpec
from navloom.runs.single_plan import POINT, map_update
from numpy.typing import NDArray

from navloom_benchmarks.pairs import Effort, Peer, PeerError, Row, paired, peer_module, timed
from navloom_benchmarks.samples import ENVELOPE, samples

__all__ = ["codec", "loop", "planner", "rays", "rooms"]

Say = Callable[[str], None]
Cell = tuple[int, int]
ROOT = 2.0**0.5


def loop(effort: Effort, say: Say) -> Iterator[Row]:
    """Mean tick of the shipped config `paper`, from the start to the goal; quick, of the first 100 ticks."""
    say("loop: the paper's drive in lockstep")
    system = assemble(load_config("paper"))
    period, ticks = system.config.run.period, effort.size(10_000, 100)

    def drive() -> float:
        make_plugins(system)
        executor = lockstep_of(system)
        done: list[int] = []
        block = timed(lambda: done.append(executor.run(ticks).ticks), 1)
        return block() / done[0]

    row = paired("paper loop, tick", "ms", drive, Peer("real time", lambda: period), effort.rounds)
    factor = 1e3 * period / row.ours
    note = f"{1e3 / row.ours:.0f} ticks/s, {factor:.0f} times real time, including sweep, map and plan"
    yield Row(**(vars(row) | {"note": note}))


def rooms(side: int) -> NDArray[np.bool_]:
    """Which cells of a (side, side) map are free, bool: connected rooms of 31 x 31 with doors of 5 and 5 % clutter."""
    from scipy import ndimage

    rng = np.random.default_rng(0)
    free = np.ones((side, side), dtype=np.bool_)
    free[::32] = free[:, ::32] = False
    for row in range(0, side, 32):
        for column in range(0, side, 32):
            across, up = rng.integers(2, 26, size=2)
            free[row, column + across : column + across + 5] = True
            free[row + up : row + up + 5, column] = True
    free &= rng.random(free.shape) >= 0.05
    parts, _ = ndimage.label(free)
    connected: NDArray[np.bool_] = parts == np.bincount(parts[free]).argmax()
    return connected


def planner(effort: Effort, say: Say) -> Iterator[Row]:
    """Queries of the planner `astar` on a map of 512 x 512 cells; quick, 128 x 128. Raises PeerError without it."""
    side = effort.size(512, 128)
    say(f"planner: {side} x {side} cells")
    free = rooms(side)
    cells = np.argwhere(free)
    picks = np.random.default_rng(1).integers(len(cells), size=(effort.size(8, 2), 2))
    queries: list[tuple[Cell, Cell]] = [(_cell(cells[a]), _cell(cells[b])) for a, b in picks]
    ours = (
        (
            f"search, {side} x {side} cells",
            _search(free),
            "searches alone: ours on a map of booleans, theirs on a map converted beforehand",
        ),
        (
            f"plan(), {side} x {side} cells",
            _planner(free),
            "ours from map message to path message, theirs a search alone",
        ),
    )
    for name, make, count in (("pyastar2d", _pyastar2d, len(queries)), ("networkx", _networkx, 2)):
        say(f"planner: {name}")
        few = queries[:count]
        try:
            search = make(free)
            peer, theirs = Peer(name, _each(search, few)), sum(search(*ends) for ends in few)
        except PeerError as error:
            peer, theirs = Peer(name, absence=str(error)), math.nan
        for what, own, note in ours:
            if peer.block is not None:
                share = 100.0 * (theirs / sum(own(*ends) for ends in few) - 1.0)
                note = f"{note}; length of {name}'s paths relative to ours: {share:+.1f} %"
            yield paired(what, "ms", _each(own, few), peer, effort.rounds, note)


def _cell(entry: NDArray[Any]) -> Cell:
    return int(entry[0]), int(entry[1])


def _each(search: Callable[[Cell, Cell], float], queries: list[tuple[Cell, Cell]]) -> Callable[[], float]:
    """A block that makes all queries and returns the time of one, s."""
    block = timed(lambda: [search(*ends) for ends in queries], 1)
    return lambda: block() / len(queries)


def _search(free: NDArray[np.bool_]) -> Callable[[Cell, Cell], float]:
    """Our search alone: returns the length of the path between two cells, in cells."""
    module = peer_module("navloom_astar.search", "navloom-astar")
    module.warm_up()
    grid = module.GridSearch(free.shape)
    return lambda start, goal: float(grid.shortest(free, start, goal).length)


def _planner(free: NDArray[np.bool_]) -> Callable[[Cell, Cell], float]:
    """Our planner on a map with cells of 1 m: returns the length of the path between two cells, m."""
    cls = Discovery().role("planner", "astar")
    assert issubclass(cls, Planner)
    cls.warm_up()
    robot = RobotSpec(rectangle(POINT, POINT), 1.2, 0.05, 0.3, 0.5, 0.5, 0.5, 1.0)
    streams = np.random.default_rng(0)
    plugin = cls(cls.Params(), Context("bench", 0.05, robot, lambda name: streams, Pose2D(0.5, 0.5, 0.0)))
    cells = np.where(free, np.int8(0), np.int8(100))
    cells.flags.writeable = False
    given = map_update(OccupancyGrid(cells, 1.0, Pose2D(0.0, 0.0, 0.0)))

    def plan(start: Cell, goal: Cell) -> float:
        begin, end = (Pose2D(cell[1] + 0.5, cell[0] + 0.5, 0.0) for cell in (start, goal))
        answer = plugin.plan(PlannerInput(PlanRequest(1, begin, end, True), given))
        assert isinstance(answer, Path), answer
        return answer.length

    return plan


def _pyastar2d(free: NDArray[np.bool_]) -> Callable[[Cell, Cell], float]:
    module = peer_module("pyastar2d", "pyastar2d")
    weights = np.where(free, np.float32(1), np.float32(np.inf))

    def search(start: Cell, goal: Cell) -> float:
        steps = np.abs(np.diff(module.astar_path(weights, start, goal, allow_diagonal=True), axis=0)).sum(axis=1)
        return float(np.where(steps == 2, ROOT, 1.0).sum())

    return search


def _networkx(free: NDArray[np.bool_]) -> Callable[[Cell, Cell], float]:
    module = peer_module("networkx", "networkx")
    graph, side = module.Graph(), len(free)
    for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for row, column in np.argwhere(free[: side - down, max(0, -across) : side - max(0, across)]).tolist():
            column += max(0, -across)
            if free[row + down, column + across] and free[row, column + across] and free[row + down, column]:
                graph.add_edge((row, column), (row + down, column + across), weight=ROOT if down and across else 1.0)

    def octile(a: Cell, b: Cell) -> float:
        down, across = abs(a[0] - b[0]), abs(a[1] - b[1])
        return max(down, across) + (ROOT - 1.0) * min(down, across)

    return lambda start, goal: float(module.astar_path_length(graph, start, goal, octile, "weight"))


def rays(effort: Effort, say: Say) -> Iterator[Row]:
    """9494 rays and 50 boxes, with the simulator's kernel. Raises PeerError without the plugin sensors_sim."""
    say("rays: 9494 rays, 50 boxes")
    casting = peer_module("navloom_sensors_sim.casting", "navloom-sensors-sim")
    scene = peer_module("navloom_sensors_sim.scene", "navloom-sensors-sim")
    rng = np.random.default_rng(0)
    boxes = _boxes(rng, 50)
    obstacles = scene.Scene(boxes, None, sweeps=False).obstacles
    ways = rng.normal(size=(9494, 3)) * [1.0, 1.0, 0.3]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins, directions = np.tile([[0.0], [0.0], [0.4]], (1, len(ways))), np.ascontiguousarray(ways.T)
    ranges, hits = np.empty(len(ways)), np.empty(len(ways), np.int64)

    def cast() -> None:
        casting.cast_block(origins, directions, obstacles, False, math.inf, ranges, hits)

    cast()
    note, count = "one thread, 64-bit floats", effort.size(10, 1)
    try:
        call, distances = _mujoco(boxes, ways)
        hit = (hits >= 0) & (distances >= 0.0)
        note += f"; ranges differ by at most {np.abs(distances - ranges)[hit].max():.0e} m"
        note += f", {np.count_nonzero((hits >= 0) != (distances >= 0.0))} rays hit in only one of them"
        peer = Peer("mujoco mj_multiRay", timed(call, count))
    except PeerError as error:
        peer = Peer("mujoco mj_multiRay", absence=str(error))
    yield paired("9494 rays, 50 boxes", "ms", timed(cast, count), peer, effort.rounds, note)


def _boxes(rng: np.random.Generator, count: int) -> list[Box]:
    """Boxes 3 to 12 m from the origin; two of three are rotated."""
    made = []
    for number in range(count):
        angle, away = rng.uniform(-math.pi, math.pi), rng.uniform(3.0, 12.0)
        x, y = away * math.cos(angle), away * math.sin(angle)
        z, yaw = float(rng.uniform(0, 1)), float(rng.uniform(-3, 3)) if number % 3 else 0.0
        hx, hy, hz = rng.uniform(0.1, 1.0, 3).tolist()
        made.append(Box(f"box {number}", (x - hx, x + hx), (y - hy, y + hy), (z, z + 2 * hz), yaw))
    return made


def _mujoco(boxes: list[Box], ways: NDArray[np.float64]) -> tuple[Callable[[], None], NDArray[np.float64]]:
    """A function that casts all rays with mj_multiRay, and the array it writes the ranges to, m; -1 for no hit.

    Raises:
        PeerError: mujoco is not installed, or has another signature of mj_multiRay.
    """
    mujoco = peer_module("mujoco", "mujoco")
    geoms = []
    for box in boxes:
        (left, right), (low, high), (bottom, top) = box.x, box.y, box.z
        size = f"{(right - left) / 2!r} {(high - low) / 2!r} {(top - bottom) / 2!r}"
        place = f"{(left + right) / 2!r} {(low + high) / 2!r} {(bottom + top) / 2!r}"
        turn = f"{math.cos(box.yaw / 2)!r} 0 0 {math.sin(box.yaw / 2)!r}"
        geoms.append(f'<geom type="box" size="{size}" pos="{place}" quat="{turn}"/>')
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(geoms)}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    count, origin, flat = len(ways), np.array([0.0, 0.0, 0.4]), ways.ravel()
    hits, distances = np.zeros(count, np.int32), np.zeros(count)

    def cast() -> None:
        mujoco.mj_multiRay(model, data, origin, flat, None, 1, -1, hits, distances, None, count, 1e10)

    try:
        cast()
    except TypeError:
        raise PeerError(
            f"mujoco {mujoco.__version__}: the arguments of its mj_multiRay differ from those of 3.2"
        ) from None
    return cast, distances


def codec(effort: Effort, say: Say) -> Iterator[Row]:
    """Encode and decode a message of 64 B and one of 110 KB, compared with pickle."""
    say("codec")
    count = effort.size(2000, 50)
    for name, message in samples().items():
        data, label = encode(message, ENVELOPE), schema_label(type(message))
        pickled = pickle.dumps((message, ENVELOPE), protocol=5)
        note = "pickle checks nothing and may run the code that it reads"
        for verb, ours, theirs in (
            (
                "encode",
                lambda m=message: encode(m, ENVELOPE),
                lambda m=message: pickle.dumps((m, ENVELOPE), protocol=5),
            ),
            ("decode", lambda d=data, t=label: decode(d, t), lambda p=pickled: pickle.loads(p)),
        ):
            peer = Peer("pickle", timed(theirs, count))
            yield paired(f"{verb} {name}", "µs", timed(ours, count), peer, effort.rounds, note)
