"""The search over a whole map: the true optimum of its score, where a robot can stand, in slices."""

import math

import numpy as np
import pytest
from navloom_scans import anywhere
from navloom_scans.anywhere import MapSearch, SearchSettings
from navloom_scans.field import distance_field
from navloom_scans.sight import is_through
from scan_localizer_rooms import beams_of, fan, flat, ranges_in

CELL = 0.1
SEEN = fan(181, 360.0)


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    anywhere.warm_up()


def search_of(walls, origin=(0.0, 0.0, 0.0), **settings):
    return MapSearch(distance_field(walls, CELL, origin, 1.0), ~walls, SearchSettings(**settings))


def seen_from(walls, place, bearings=SEEN):
    beams = beams_of(ranges_in(walls, CELL, place, bearings), bearings)
    return beams, len(beams)


@pytest.mark.parametrize("place", [(2.0, 2.5, 0.3), (6.3, 1.2, -2.0), (3.2, 5.0, 3.0), (7.5, 4.4, 1.0)])
@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-4.0, 7.0, 0.8)])
def test_a_scan_is_found_anywhere_in_a_flat(place, origin):
    walls = flat()
    poses, scores = search_of(walls, origin).search(*seen_from(walls, place), 5)
    c, s = math.cos(origin[2]), math.sin(origin[2])
    x, y = origin[0] + c * place[0] - s * place[1], origin[1] + s * place[0] + c * place[1]
    assert math.dist(poses[0, :2], (x, y)) < 0.02
    assert abs(math.remainder(poses[0, 2] - place[2] - origin[2], math.tau)) < 0.01
    assert scores[0] > 0.95


def every_score(search, walls):
    """(headings, rows, columns) score of every position of the lattice, -1 where the robot cannot stand: no pyramid."""
    s, field = search.settings, search.field
    rows, columns = walls.shape
    middle = field.values[1::2, 1::2]
    values = np.rint(255 * np.clip(1.0 - np.abs(middle) / s.width, 0.0, 1.0)).astype(int)
    scores = np.full((len(search._turns), rows, columns), -1)
    for k, turn in enumerate(search._turns):
        c, sn = math.cos(turn), math.sin(turn)
        for r in range(rows):
            for q in range(columns):
                if walls[r, q] or middle[r, q] <= s.clearance:
                    continue
                total, x, y = 0, (q + 0.5) * CELL, (r + 0.5) * CELL
                for (down, across), ray in zip(search._offsets[k], search._rays, strict=True):
                    if 0 <= r + down < rows and 0 <= q + across < columns:
                        total += values[r + down, q + across]
                    px, py, dx, dy = (c * ray[0] - sn * ray[1], sn * ray[0] + c * ray[1],
                                      c * ray[2] - sn * ray[3], sn * ray[2] + c * ray[3])  # fmt: skip
                    back = ray[0] * ray[2] + ray[1] * ray[3]
                    total -= 255 * is_through(field.values, field.frame, x + px, y + py, dx, dy, back, s.gate)
                scores[k, r, q] = total
    return scores


def test_the_best_places_are_those_of_trying_every_one():
    walls = np.ones((24, 30), dtype=np.bool_)
    walls[1:-1, 1:-1] = False
    walls[8:11, 18:21] = True
    search = search_of(walls, beams=12, most_turn=math.radians(20.0), least=0.3, margin=1.0)
    beams, echoes = seen_from(walls, (1.4, 1.9, 0.7))
    # Half of the beams end on something unmapped, so that the best place is not an obvious one.
    beams[::2, :2] *= 0.6
    search.search(beams, echoes, 6)
    scores, turns, tried = every_score(search, walls), search._turns, []
    for k, r, q in sorted(np.argwhere(scores >= search._limits[5]).tolist(), key=lambda at: -scores[tuple(at)]):
        turned = [abs(math.remainder(turns[k] - turns[j], math.tau)) for j, _, _ in tried]
        off = [CELL * math.hypot(r - i, q - p) for _, i, p in tried]
        near = [d < 0.5 and a < math.radians(15.0) for d, a in zip(off, turned, strict=True)]
        # Of equal places either may come first; each lies near the other, or both are found.
        if not any(near):
            tried.append((k, r, q))
    found = search._found[: search._marks[4], 3]
    expected = [scores[at] for at in tried[:6]]
    assert found[0] == expected[0] == scores.max()
    assert found == pytest.approx(expected, abs=0.02 * scores.max())


def test_slices_find_the_same_as_one_search():
    walls = flat()
    beams, echoes = seen_from(walls, (2.0, 2.5, 0.3))
    search = search_of(walls)
    whole = search.search(beams, echoes, 5)
    work = search.work
    search.begin(beams, echoes, 5)
    slices = 1
    while not search.step(500):
        slices += 1
    assert [part.tobytes() for part in search.result()] == [part.tobytes() for part in whole]
    assert search.work == work
    assert slices >= work // 1500


def test_a_search_that_takes_too_long_goes_on_with_the_best_and_says_so():
    walls = flat()
    search = search_of(walls, most_work=2500)
    poses, _ = search.search(*seen_from(walls, (2.0, 2.5, 0.3)), 5)
    assert not search.is_complete
    assert math.dist(poses[0, :2], (2.0, 2.5)) < 0.02
    search = search_of(walls)
    search.search(*seen_from(walls, (2.0, 2.5, 0.3)), 5)
    assert search.is_complete


def test_places_are_apart_and_free():
    walls = flat()
    places, scores = search_of(walls, least=0.2, margin=1.0).search(*seen_from(walls, (2.0, 2.5, 0.3)), 20)
    assert len(places) == 3
    assert (np.diff(scores) <= 0.0).all()
    for i, one in enumerate(places):
        assert not walls[int(one[1] / CELL), int(one[0] / CELL)]
        for other in places[:i]:
            turned = abs(math.remainder(one[2] - other[2], math.tau))
            assert math.dist(one[:2], other[:2]) >= 0.25 or turned >= math.radians(7.5)


def test_unknown_cells_are_no_place_to_stand():
    walls = flat()
    field, free = distance_field(walls, CELL, (0.0, 0.0, 0.0), 1.0), ~walls
    free[:, :45] = False
    places, _ = MapSearch(field, free).search(*seen_from(walls, (2.0, 2.5, 0.3)), 5)
    assert (places[:, 0] > 4.5).all()


def test_a_guess_limits_the_search():
    # A square room looks the same from four headings; a guess of the heading leaves one.
    walls = np.ones((50, 50), dtype=np.bool_)
    walls[1:-1, 1:-1] = False
    beams, echoes = seen_from(walls, (2.5, 2.5, 0.4))
    search = search_of(walls)
    headings = sorted(search.search(beams, echoes, 10)[0][:, 2])
    assert headings == pytest.approx([0.4 - math.pi, 0.4 - math.pi / 2, 0.4, 0.4 + math.pi / 2], abs=0.02)
    places, _ = search.search(beams, echoes, 10, np.array([2.3, 2.6, 0.3]), (0.2, 0.2))
    assert places[:, 2] == pytest.approx([0.4], abs=0.02)


def test_people_who_hide_most_of_the_view_change_nothing():
    walls, place = flat(), (6.3, 1.2, -2.0)
    ranges = ranges_in(walls, CELL, place, SEEN)
    crowd = (np.arange(181) // 20) % 3 > 0
    near = np.where(crowd, np.minimum(ranges, 0.7), ranges)
    poses, _ = search_of(walls).search(beams_of(near, SEEN), 181, 5)
    assert 0.6 < crowd.mean() < 0.7
    assert math.dist(poses[0, :2], place[:2]) < 0.05


def test_beams_through_a_mapped_wall_are_evidence_against():
    # Two halls of equal outer walls, one divided: from the open one, beams would pass through the divider.
    walls = np.ones((40, 130), dtype=np.bool_)
    walls[1:-1, 1:64] = walls[1:-1, 66:129] = False
    walls[1:-1, 30:33] = True
    walls[18:22, 30:33] = False
    poses, _ = search_of(walls).search(*seen_from(walls, (9.0, 2.0, 0.2)), 10)
    assert (poses[:, 0] > 6.5).all()


def test_a_scan_without_echoes_has_no_place():
    walls = flat()
    places, scores = search_of(walls).search(np.empty((0, 4)), 0, 5)
    assert places.shape == (0, 3)
    assert scores.shape == (0,)


def test_large_maps_have_a_coarser_lattice(monkeypatch):
    monkeypatch.setattr(anywhere, "_MAX_CELLS", 1500)
    walls = flat()
    search = search_of(walls)
    assert search._step == 0.2
    poses, _ = search.search(*seen_from(walls, (6.3, 1.2, -2.0)), 5)
    assert math.dist(poses[0, :2], (6.3, 1.2)) < 0.02
