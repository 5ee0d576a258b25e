import heapq
import math
from collections import defaultdict
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import polygon
from navloom.geometry.grid import world_to_grid
from navloom.geometry.world import Box, Cylinder, Place, Raster, World
from navloom.worlds.paper_world import paper_gates, paper_gates_blocked_b, paper_gates_blocked_bc, paper_gates_open_a
from navloom_optimal import buckets, shapes, shortest_path, tangent_search, visible_tangents
from navloom_optimal.circles import Circles, circles_of
from navloom_optimal.shortest_path import length_to_reach, optimal_length, optimal_path, warm_up

START, GOAL = Place(0.0, 0.0), Place(10.0, 0.0)


def length(*obstacles: Box | Cylinder, start: Place = START, goal: Place = GOAL, radius: float = 0.5) -> float | None:
    return optimal_length(World("w", obstacles), start, goal, radius, 1.2)


def test_the_way_is_straight_in_an_empty_world() -> None:
    assert length() == 10.0
    assert length(Cylinder("beside", 5.0, 1.5, 1.0)) == 10.0
    assert length(goal=START) == 0.0


def test_round_one_cylinder_it_is_tangent_arc_tangent() -> None:
    around = 2.0 * math.sqrt(25.0 - 1.0) + (math.pi - 2.0 * math.acos(1.0 / 5.0))
    assert length(Cylinder("post", 5.0, 0.0, 0.5)) == pytest.approx(around, abs=1e-12)


def test_round_two_cylinders_on_different_sides_it_crosses_between_them() -> None:
    # Centres (3, -0.8) and (7, 0.8), inflated radius 1: over the first, under the second, by an inner tangent.
    between = math.hypot(4.0, 1.6)
    inner = math.sqrt(between**2 - 4.0)
    to_first = math.hypot(3.0, 0.8)
    tangent = math.sqrt(to_first**2 - 1.0)
    bearing_in = math.atan2(-0.8, 3.0) + math.asin(1.0 / to_first)
    bearing_across = math.atan2(1.6, 4.0) - math.asin(2.0 / between)
    expected = 2.0 * tangent + inner + 2.0 * (bearing_in - bearing_across)
    posts = Cylinder("a", 3.0, -0.8, 0.5), Cylinder("b", 7.0, 0.8, 0.5)
    assert length(*posts) == pytest.approx(expected, abs=1e-9)


def test_a_box_corner_is_rounded_by_the_disc() -> None:
    # Down the left side of x = 0..inf, y = -inf..0: from (-0.5, -4) up, a quarter arc, and right to (4, 0.5).
    corner = Box("block", (0.0, 50.0), (-50.0, 0.0))
    expected = 4.0 + 0.5 * math.pi / 2.0 + 4.0
    assert length(corner, start=Place(-0.5, -4.0), goal=Place(4.0, 0.5)) == pytest.approx(expected, abs=1e-6)


def test_a_turned_box_is_passed_at_its_corner() -> None:
    # A square of half diagonal 1 standing on its corner at (5, 0): the disc rolls over the corner (5, 1).
    box = Box(
        "diamond", (5.0 - math.sqrt(0.5), 5.0 + math.sqrt(0.5)), (-math.sqrt(0.5), math.sqrt(0.5)), yaw=math.pi / 4
    )
    far = math.hypot(5.0, 1.0)
    expected = 2.0 * (math.sqrt(far**2 - 0.25) + 0.5 * (math.asin(0.5 / far) + math.atan2(1.0, 5.0)))
    assert length(box) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("gap", "through"), [(1.0, True), (1.01, True), (0.99, False)])
def test_a_gap_as_wide_as_the_disc_is_just_passed(gap: float, through: bool) -> None:
    walls = Box("low", (4.0, 6.0), (-20.0, -gap / 2)), Box("high", (4.0, 6.0), (gap / 2, 20.0))
    found = length(*walls)
    assert found is not None
    assert (found == 10.0) is through


@pytest.mark.parametrize("end", [Place(5.0, 0.0), Place(5.0, 1.2)])
def test_there_is_no_way_into_an_obstacle(end: Place) -> None:
    assert length(Cylinder("post", 5.0, 0.0, 1.0), goal=end) is None
    assert length(Cylinder("post", 5.0, 0.0, 1.0), start=end) is None


def test_there_is_no_way_into_a_closed_room() -> None:
    room = (
        Box("s", (8.0, 12.0), (-2.2, -2.0)),
        Box("n", (8.0, 12.0), (2.0, 2.2)),
        Box("w", (8.0, 8.2), (-2.2, 2.2)),
        Box("e", (11.8, 12.0), (-2.2, 2.2)),
    )
    assert length(*room) is None


def test_obstacles_that_move_appear_later_or_hang_above_do_not_count() -> None:
    wall = (4.0, 4.2), (-3.0, 3.0)
    assert length(Box("late", *wall, appears_at=1.0), Box("girder", *wall, (1.2, 1.4))) == 10.0
    assert length(Box("swept", *wall, appears_after_sweep=True)) == 10.0
    assert length(Cylinder("walker", 5.0, 0.0, 1.0, waypoints=((0.0, 5.0, 0.0),))) == 10.0


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan])
def test_a_disc_has_a_radius(radius: float) -> None:
    with pytest.raises(ValueError, match="radius"):
        length(radius=radius)


def of_paper(world: World) -> float | None:
    assert world.start is not None
    assert world.goal is not None
    return optimal_length(world, world.start, world.goal, 0.4, 1.2)


def test_the_gates_of_the_paper() -> None:
    """Straight through gate A without its girder; else past the ends of the gate's posts, rounded by 0.4 m."""
    assert of_paper(paper_gates_open_a()) == 7.6
    # Corner (1.4, 5.2) of post A/B: tangent from the start, an arc, the wall's thickness, an arc, tangent to the goal.
    before, after = math.hypot(1.4, 5.2), math.hypot(1.4, 2.2)
    bend_in = math.atan2(1.4, 5.2) + math.asin(0.4 / before)
    bend_out = math.atan2(1.4, 2.2) + math.asin(0.4 / after)
    expected = math.sqrt(before**2 - 0.16) + math.sqrt(after**2 - 0.16) + 0.2 + 0.4 * (bend_in + bend_out)
    assert of_paper(paper_gates()) == pytest.approx(expected, abs=1e-9)
    assert expected == pytest.approx(8.570, abs=1e-3)


def test_the_corridor_of_the_paper_is_longer_and_with_it_closed_there_is_no_way() -> None:
    # Corners (4.2, 5.2) and (4.2, 6.8) of the partition; from the second the way goes to the goal, clear of the third.
    before, after = math.hypot(4.2, 5.2), math.hypot(4.2, 0.8)
    bend_in = math.atan2(4.2, 5.2) + math.asin(0.4 / before)
    bend_out = math.pi / 2 - math.atan2(0.8, 4.2) + math.asin(0.4 / after)
    expected = math.sqrt(before**2 - 0.16) + math.sqrt(after**2 - 0.16) + 1.6 + 0.4 * (bend_in + bend_out)
    assert of_paper(paper_gates_blocked_b()) == pytest.approx(expected, abs=1e-9)
    assert of_paper(paper_gates_blocked_bc()) is None


def as_raster(world: World, resolution: float) -> World:
    grid = world_to_grid(world, resolution, (0.0, 1.2))
    return World("drawn", raster=Raster("cells", grid.cells == 100, resolution, grid.origin), bounds=world.bounds)


@pytest.mark.parametrize("resolution", [0.2, 0.1, 0.05])
def test_a_world_drawn_exactly_on_a_raster_has_the_same_optimum(resolution: float) -> None:
    world = paper_gates()
    drawn = as_raster(World("w", world.obstacles, bounds=(-4.8, -1.2, 7.2, 9.6)), resolution)
    exact = of_paper(world)
    assert optimal_length(drawn, Place(0.0, 0.0), Place(0.0, 7.6), 0.4, 1.2) == pytest.approx(exact, abs=1e-9)


def test_a_turned_raster_changes_nothing() -> None:
    cells = np.zeros((40, 60), dtype=np.bool_)
    cells[:25, 30] = True
    flat = optimal_length(World("flat", raster=Raster("r", cells, 0.1)), Place(1.0, 1.0), Place(5.0, 1.2), 0.25, 1.2)
    turned = Raster("r", cells, 0.1, Place(7.0, -2.0, math.pi / 2))
    found = optimal_path(World("turned", raster=turned), Place(6.0, -1.0), Place(5.8, 3.0), 0.25, 1.2)
    assert found is not None
    assert found.length == pytest.approx(flat, abs=1e-9)
    assert np.allclose(found.points[[0, -1]], [(6.0, -1.0), (5.8, 3.0)])


def test_obstacles_on_a_raster_count_too() -> None:
    empty = Raster("floor", np.zeros((80, 120), dtype=np.bool_), 0.1, Place(-1.0, -4.0))
    post = Cylinder("post", 5.0, 0.0, 0.5)
    found = optimal_length(World("w", (post,), empty), START, GOAL, 0.5, 1.2)
    around = 2.0 * math.sqrt(25.0 - 1.0) + (math.pi - 2.0 * math.acos(1.0 / 5.0))
    assert found == pytest.approx(around, abs=1e-9)


def test_the_edge_of_a_raster_is_not_passed() -> None:
    cells = np.zeros((20, 40), dtype=np.bool_)
    cells[:, 20] = True
    world = World("w", raster=Raster("r", cells, 0.1))
    assert optimal_length(world, Place(1.0, 1.0), Place(3.0, 1.0), 0.2, 1.2) is None
    assert optimal_length(world, Place(1.0, 1.0), Place(-1.0, 1.0), 0.2, 1.2) is None
    assert optimal_length(world, Place(-9.0, 1.0), Place(-8.0, 1.0), 0.2, 1.2) is None
    assert optimal_length(world, Place(0.0, 0.0), Place(0.0, 2.0), 0.2, 1.2) == 2.0


def test_a_one_cell_corridor_is_passed_on_its_middle_line() -> None:
    cells = np.ones((3, 9), dtype=np.bool_)
    cells[1] = False
    world = World("w", raster=Raster("r", cells, 1.0))
    assert optimal_length(world, Place(1.5, 1.5), Place(7.5, 1.5), 0.5, 1.2) == 6.0
    assert optimal_length(world, Place(1.5, 1.5), Place(7.5, 1.5), 0.51, 1.2) is None


def cells_and_boxes(seed: int) -> tuple[World, World]:
    """A random raster with a wall round it, and the same world with a box for each cell."""
    cells = np.random.default_rng(seed).random((14, 14)) < 0.18
    cells[[0, -1]] = cells[:, [0, -1]] = True
    cells[2:4, 2:4] = cells[-4:-2, -4:-2] = False
    boxes = [Box(f"{r} {c}", (c, c + 1.0), (r, r + 1.0)) for r, c in np.argwhere(cells).tolist()]
    return World("cells", raster=Raster("r", cells, 1.0)), World("boxes", tuple(boxes))


@pytest.mark.parametrize("seed", range(12))
def test_the_optimum_on_a_raster_is_that_of_a_box_for_each_cell(seed: int) -> None:
    raster, boxes = cells_and_boxes(seed)
    start, goal = Place(3.0, 3.0), Place(11.0, 11.0)
    found = optimal_length(raster, start, goal, 0.3, 1.2)
    exact = optimal_length(boxes, start, goal, 0.3, 1.2)
    assert found == (exact and pytest.approx(exact, abs=1e-9))


@pytest.mark.parametrize(("gap", "through"), [(0.99, False), (1.0, True)])
def test_a_gap_between_corners_of_cells_is_passed_if_it_is_as_wide_as_the_disc(gap: float, through: bool) -> None:
    cells = np.ones((8, 8), dtype=np.bool_)
    cells[:4, 4:] = cells[4:, :4] = False
    cells[3, 3] = cells[4, 4] = False
    # The corners (3, 4), (4, 3) and (4, 5), (5, 4) of the two blocks are √2 cells apart.
    edge = gap / math.sqrt(2.0)
    world = World("w", raster=Raster("r", cells, edge))
    found = optimal_length(world, Place(6.0 * edge, 2.0 * edge), Place(2.0 * edge, 6.0 * edge), 0.5, 1.2)
    assert (found is not None) is through


def test_the_cells_of_a_raster_are_few_boxes() -> None:
    cells = np.zeros((5, 6), dtype=np.bool_)
    cells[1:4, 2:5] = cells[4, 2:4] = cells[0, 0] = True
    assert shortest_path._rectangles(cells).T.tolist() == [[0, 1, 0, 1], [2, 4, 4, 5], [2, 5, 1, 4]]
    assert shortest_path._rectangles(np.zeros((2, 3), dtype=np.bool_)).shape == (4, 0)


DISC = polygon([(0.2999 * math.cos(a), 0.2999 * math.sin(a)) for a in np.linspace(0.0, math.tau, 32, endpoint=False)])


@settings(deadline=None, max_examples=12)
@given(st.integers(0, 2**32))
def test_the_path_found_is_free_and_as_long_as_it_says(seed: int) -> None:
    stream = np.random.default_rng(seed)
    posts = [Cylinder(f"{k}", *p) for k, p in enumerate(stream.uniform((1, -3, 0.1), (9, 3, 0.8), (8, 3)).tolist())]
    corners = stream.uniform((1, -3), (8, 3), (3, 2)).tolist()
    boxes = [Box(f"b{k}", (x, x + 1.0), (y, y + 0.4), yaw=7.0 * y) for k, (x, y) in enumerate(corners)]
    world = World("random", (*posts, *boxes))
    path = optimal_path(world, START, GOAL, 0.3, 1.2)
    assert path is not None
    assert path.length >= 10.0
    drawn = sum(math.dist(a, b) for a, b in pairwise(path.points.tolist()))
    # Chords of arcs of 5 degrees are shorter than the arcs by less than 0.04 %.
    assert path.length * 0.9996 <= drawn <= path.length + 1e-9
    for (ax, ay), (bx, by) in pairwise(path.points.tolist()):
        for share in (0.0, 0.5):
            pose = Place(ax + share * (bx - ax), ay + share * (by - ay))
            # The middle of a chord lies up to 1.1 m * (1 - cos 2.5 degrees) inside its arc.
            assert clearance(DISC * 0.99, pose, world, height=1.2)[0] > 0.0


def scattered(stream: np.random.Generator, count: int, size: float) -> World:
    """Boxes, turned boxes, thin walls, cells of a grid that touch, and cylinders, about `size` m square."""
    obstacles: list[Box | Cylinder] = []
    for k in range(count):
        x, y, wide, tall = *stream.uniform(0.0, size, 2).tolist(), *stream.uniform(0.1, 1.5, 2).tolist()
        box = ((x, x + wide), (y, y + tall))
        cell = ((math.floor(x), math.floor(x) + 1.0), (math.floor(y), math.floor(y) + 1.0))
        made = (
            Box(f"{k}", *box),
            Box(f"{k}", *box, yaw=7.0 * tall),
            Box(f"{k}", (x, x + 4.0 * wide), (y, y + 0.1), yaw=math.pi / 2 * math.floor(2.0 * tall)),
            Box(f"{k}", *cell),
            Cylinder(f"{k}", x, y, 0.4 * wide),
        )
        obstacles.append(made[k % 5])
    return World("scattered", tuple(obstacles))


def whole_graph_length(circles: Circles, sorted_shapes: buckets.Buckets) -> float:
    """Length of the shortest path in the graph of all free tangents and arcs, m; infinite if there is none."""
    (x, y, r), (first, extent) = circles.places.T, circles.usable.T
    one, other = np.triu_indices(len(r), 1)
    on: dict[int, dict[float, None]] = defaultdict(dict)
    edges: dict[tuple[int, float], list[tuple[tuple[int, float], float]]] = defaultdict(list)

    def join(a: tuple[int, float], b: tuple[int, float], length: float) -> None:
        edges[a].append((b, length))
        edges[b].append((a, length))

    for turns in product((1.0, -1.0), repeat=2):
        away, bearing = np.hypot(x[other] - x[one], y[other] - y[one]), np.arctan2(y[other] - y[one], x[other] - x[one])
        with np.errstate(all="ignore"):
            normal = bearing - np.arccos((turns[0] * r[one] - turns[1] * r[other]) / away)
        ends, past = [], []
        for at, turn in zip((one, other), turns, strict=True):
            ends += [x[at] + turn * r[at] * np.cos(normal), y[at] + turn * r[at] * np.sin(normal)]
            angle = normal + (0.0 if turn > 0.0 else math.pi) - first[at] + 1e-9
            past.append(np.where(r[at] > 0.0, angle % (2.0 * math.pi) - 1e-9, 0.0))
        usable = (past[0] <= extent[one] + 1e-9) & (past[1] <= extent[other] + 1e-9)
        for k in np.flatnonzero(usable).tolist():
            segment = [float(column[k]) for column in ends]
            if buckets.segment_is_free(*segment, sorted_shapes):
                vertices = [(int(at[k]), float(p[k])) for at, p in zip((one, other), past, strict=True)]
                join(vertices[0], vertices[1], math.dist(segment[:2], segment[2:]))
                for circle, position in vertices:
                    on[circle][position] = None
    for circle, positions in on.items():
        track = sorted(positions)
        if extent[circle] > 6.28 and r[circle] > 0.0:
            track.append(track[0] + 2.0 * math.pi)
        for low, high in pairwise(track):
            arc = float(first[circle]) + low, float(first[circle]) + high
            if buckets.arc_is_free(*circles.places[circle].tolist(), *arc, int(circles.owners[circle]), sorted_shapes):
                join((circle, low), (circle, high if high in positions else track[0]), (high - low) * float(r[circle]))
    costs, heap = {(0, 0.0): 0.0}, [(0.0, (0, 0.0))]
    while heap:
        cost, vertex = heapq.heappop(heap)
        if vertex == (1, 0.0):
            return cost
        for target, more in edges[vertex] if cost == costs[vertex] else ():
            if cost + more < costs.get(target, math.inf):
                costs[target] = cost + more
                heapq.heappush(heap, (cost + more, target))
    return math.inf


def compare_with_the_whole_graph(seed: int) -> bool:
    """Check that the way is as long as in the graph of all tangents; returns whether there is one."""
    stream = np.random.default_rng(seed)
    world, radius = scattered(stream, int(stream.integers(2, 40)), 10.0), float(stream.choice([0.1, 0.25, 0.5]))
    ends = (-0.7, -0.7), (11.5, 11.5)
    found = optimal_length(world, *(Place(*end) for end in ends), radius, 1.2)
    sorted_shapes = buckets.buckets_of(
        inflated := shortest_path._shapes(list(world.obstacles), Place(0.0, 0.0), radius)
    )
    is_free = all(buckets.segment_is_free(*end, *end, sorted_shapes) for end in ends)
    whole = whole_graph_length(circles_of(inflated, np.array(ends)), sorted_shapes) if is_free else math.inf
    assert (math.inf if found is None else found) == pytest.approx(whole, abs=1e-9, rel=0.0)
    return found is not None


def test_the_lazy_search_finds_the_way_of_the_whole_tangent_graph() -> None:
    assert sum(compare_with_the_whole_graph(seed) for seed in range(60)) >= 40


@pytest.mark.slow
def test_the_lazy_search_finds_the_way_of_the_whole_tangent_graph_in_hundreds_of_worlds() -> None:
    assert sum(compare_with_the_whole_graph(seed) for seed in range(100, 900)) >= 500


def test_a_search_with_buckets_gives_the_same_answer_as_over_all_shapes() -> None:
    stream = np.random.default_rng(3)
    world = scattered(stream, 200, 20.0)
    obstacles = [*world.obstacles, Box("long", (-30.0, 50.0), (9.0, 9.1), yaw=0.4)]
    inflated = shortest_path._shapes(obstacles, Place(0.0, 0.0), 0.3)
    all_shapes, sorted_shapes = (inflated.boxes, inflated.discs, 0.3), buckets.buckets_of(inflated)
    segments = stream.uniform(-6.0, 26.0, (300, 4))
    segments[:, 2:] = segments[:, :2] + stream.normal(0.0, 2.0, (300, 2))
    circles = np.concatenate([segments[:, :2], stream.uniform(0.0, 1.0, (300, 1))], axis=1)
    angles = np.sort(stream.uniform(-math.pi, math.pi, (300, 2)), axis=1)
    free = [buckets.segment_is_free(*ends, sorted_shapes) for ends in segments.tolist()]
    near = [[shapes.is_near_segment(k, *ends, *all_shapes) for k in range(201)] for ends in segments.tolist()]
    assert free == [not any(of_each) for of_each in near]
    arcs = []
    for (x, y, r), (first, last) in zip(circles.tolist(), angles.tolist(), strict=True):
        arcs.append(buckets.arc_is_free(x, y, r, first, last, -1, sorted_shapes))
        at = [(x + r * math.cos(a), y + r * math.sin(a)) for a in np.linspace(first, last, 200).tolist()]
        gap = min(shapes.gap_to(k, *point, *all_shapes) for point in at for k in range(201))
        assert gap >= -1e-6 if arcs[-1] else gap < 0.01
    assert 60 < sum(free) < 240
    assert 20 < sum(arcs) < 280


def looked_at(count: int) -> tuple[int, int]:
    """Sides that the search expanded, and tangents it tested, in a world of `count` boxes of constant density."""
    size = math.sqrt(count / 0.15)
    corners = np.random.default_rng(7).uniform(0.0, size, (count, 2)).tolist()
    boxes = [Box(f"{k}", (x, x + 0.8), (y, y + 0.5), yaw=x) for k, (x, y) in enumerate(corners)]
    inflated = shortest_path._shapes(list(boxes), Place(0.0, 0.0), 0.4)
    circles = circles_of(inflated, np.array([(-1.5, -1.5), (size + 1.5, size + 1.5)]))
    search = tangent_search.TangentSearch(circles, buckets.buckets_of(inflated))
    assert search.run() is not None
    return len(search.sides), search.looked_at


def test_the_work_grows_with_the_boxes_and_not_with_their_square() -> None:
    """The whole graph tests 8 n (n - 1) / 2 tangents of n circles: 4 million for 250 boxes, 64 million for 1000."""
    few, many = looked_at(250), looked_at(1000)
    assert many[0] < 8 * few[0]
    assert many[1] < 8 * few[1]
    assert many[1] < 400_000


@pytest.mark.parametrize("is_goal_closed_in", [True, False])
def test_there_is_no_way_between_a_closed_room_and_a_crowded_plain(is_goal_closed_in: bool) -> None:
    corners = np.random.default_rng(1).uniform(0.0, 40.0, (250, 2)).tolist()
    boxes = [Box(f"{k}", (x, x + 0.8), (y, y + 0.5)) for k, (x, y) in enumerate(corners)]
    ring = np.linspace(0.0, math.tau, 24, endpoint=False).tolist()
    room = [Cylinder(f"post {a}", 50.0 + 4.0 * math.cos(a), 50.0 + 4.0 * math.sin(a), 0.2) for a in ring]
    ends = Place(-1.5, -1.5), Place(50.0, 50.0)
    if not is_goal_closed_in:
        ends = ends[::-1]
    assert length(*boxes, *room, start=ends[0], goal=ends[1], radius=0.4) is None


KERNELS = (shapes, buckets, visible_tangents)


def test_the_warm_up_compiles_all_there_is_to_compile() -> None:
    kernels = [k for m in KERNELS for k in vars(m).values() if is_kernel(k)]
    warm_up()
    compiled = [len(k.nopython_signatures) for k in kernels]
    of_paper(paper_gates())
    cells = np.zeros((30, 30), dtype=np.bool_)
    cells[10, 5:] = True
    cells.flags.writeable = False
    drawn = World("w", (Cylinder("c", 1.0, 0.5, 0.1),), Raster("r", cells, 0.1))
    assert optimal_length(drawn, Place(2.0, 0.5), Place(2.0, 2.0), 0.2, 1.2) is not None
    assert [len(k.nopython_signatures) for k in kernels] == compiled
    assert len(kernels) >= 15


def is_kernel(thing: object) -> bool:
    return hasattr(thing, "nopython_signatures")


def test_the_way_to_within_reach_of_the_goal_ends_at_the_disc() -> None:
    straight = optimal_path(World("empty"), Place(0.0, 0.0), Place(3.0, 4.0), 0.2, 1.2)
    assert straight is not None
    for reach, length in ((0.0, 5.0), (1.0, 4.0), (4.999, 0.001), (5.0, 0.0), (9.0, 0.0)):
        assert length_to_reach(straight, reach) == pytest.approx(length, abs=1e-9)
    post = World("post", (Cylinder("post", 0.0, 3.0, 0.5),))
    around = optimal_path(post, Place(0.0, 0.0), Place(0.0, 6.0), 0.2, 1.2)
    assert around is not None and len(around.points) > 3
    # The last leg is a straight tangent of √(3² - 0.7²) m: 1 m of it need not be driven.
    assert length_to_reach(around, 1.0) == pytest.approx(around.length - 1.0, abs=1e-9)
