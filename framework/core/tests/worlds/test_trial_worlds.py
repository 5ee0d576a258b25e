import math
from itertools import combinations
from pathlib import Path

import pytest
from navloom.geometry.world import Box, Cylinder, World, position_at
from navloom.worlds import SCHEMES, WORLDS, WorldError
from navloom_optimal.shortest_path import optimal_length

HERE = Path()


def best(world: World, radius: float = 0.4) -> float | None:
    assert world.start is not None
    assert world.goal is not None
    return optimal_length(world, world.start, world.goal, radius, 1.2)


def test_empty_and_corridor_are_driven_straight() -> None:
    assert best(WORLDS["empty"]()) == 6.0
    assert best(WORLDS["corridor"]()) == 8.0


def test_the_door_is_1_2_m_wide_and_beside_the_straight_way() -> None:
    length = best(WORLDS["doorway"]())
    assert length is not None
    # By way of the door's left end, (1.4, 3.0..3.2), with 0.4 m to it: at least through (1.8, 3.1).
    assert 6.5 < length < 2.0 * math.hypot(2.0, 3.0)
    assert best(WORLDS["doorway"](), radius=0.61) is None


def test_the_trap_is_passed_on_its_outside() -> None:
    length = best(WORLDS["u_trap"]())
    assert length is not None
    # Past (1.7, 2.0) and (1.7, 5.2), rounded by 0.4 m.
    assert length > math.hypot(1.7, 2.0) + 3.2 + math.hypot(1.7, 2.8)
    assert length < math.hypot(2.1, 1.6) + 4.0 + math.hypot(2.1, 2.4)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 99, 123456789])
def test_clutter_is_20_posts_with_room_for_a_robot_between_them(seed: int) -> None:
    world = SCHEMES["clutter"](str(seed), HERE)
    posts = [o for o in world.obstacles if isinstance(o, Cylinder)]
    assert len(posts) == 20
    assert {p.radius for p in posts} == {0.1}
    assert all(-6.0 <= p.x <= 6.0 and 1.0 <= p.y <= 13.0 for p in posts)
    assert min(math.hypot(a.x - b.x, a.y - b.y) for a, b in combinations(posts, 2)) >= 1.8
    length = best(world)
    assert length is not None
    assert 15.0 <= length < 17.0


def test_clutter_is_the_same_for_the_same_seed_only() -> None:
    assert SCHEMES["clutter"]("7", HERE).obstacles == SCHEMES["clutter"]("7", HERE).obstacles
    assert SCHEMES["clutter"]("7", HERE).obstacles != SCHEMES["clutter"]("8", HERE).obstacles


@pytest.mark.parametrize("seed", ["", "x", "-1", "1.5", "²", "9" * 30])
def test_a_seed_is_a_whole_number(seed: str) -> None:
    with pytest.raises(WorldError, match=r"clutter:.*seed"):
        SCHEMES["clutter"](seed, HERE)


@pytest.mark.parametrize("width", ["0.8", "1.6", "2.0", "4"])
def test_a_door_is_as_wide_as_asked_and_1_m_beside_the_straight_way(width: str) -> None:
    world = SCHEMES["door"](width, HERE)
    left, right = (o for o in world.obstacles if isinstance(o, Box) and o.name.startswith("door wall"))
    assert right.x[0] - left.x[1] == pytest.approx(float(width))
    assert 0.5 * (right.x[0] + left.x[1]) == pytest.approx(1.0)
    assert left.appears_after_sweep and right.appears_after_sweep


@pytest.mark.parametrize("width", ["", "wide", "0.7", "4.1", "nan", "inf", "-2"])
def test_a_door_has_a_width(width: str) -> None:
    with pytest.raises(WorldError, match=r"door:.*width from 0\.8 to 4 m"):
        SCHEMES["door"](width, HERE)


def test_the_person_crosses_the_whole_corridor_at_0_4_m_s_and_rests() -> None:
    (person,) = (o for o in WORLDS["crossing_person"]().obstacles if isinstance(o, Cylinder))
    # 5 s at rest, 3 m in 7.5 s, 5 s at rest, and back: 25 s.
    at = [position_at(person.waypoints, person.loops, time) for time in (1.0, 8.75, 15.0, 21.25, 26.0)]
    assert at == [(-1.5, 4.5), (0.0, 4.5), (1.5, 4.5), (0.0, 4.5), (-1.5, 4.5)]
    assert best(WORLDS["crossing_person"]()) == pytest.approx(9.0, abs=0.6)
