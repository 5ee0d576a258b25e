"""Random crowds, and exact solvers of the linear programmes by enumeration in extended precision."""

from itertools import combinations

import numpy as np
from navloom_orca.half_planes import put_agent

FASTEST = 2.0
HORIZON, PERIOD = 5.0, 0.05


def crowd_of(rng, count, size, gap=0.0):
    """A crowd of discs in a square: positions, velocities, radii, preferred and highest speeds, in 32-bit values.

    Args:
        rng: Random stream. count: Agents. size: Half width of the square, m.
        gap: Least gap between two agents, m; None for agents that may overlap.
    """
    radii, positions = rng.uniform(0.2, 0.4, count), np.zeros((0, 2))
    while len(positions) < count:
        place, k = rng.uniform(-size, size, 2), len(positions)
        if gap is None or (np.hypot(*(positions - place).T) > radii[:k] + radii[k] + gap).all():
            positions = np.vstack([positions, place])
    angles, speeds = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.0, 1.5, count)
    velocities = speeds[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    preferred, fastest = rng.uniform(-1.5, 1.5, (count, 2)), np.full(count, FASTEST)
    return [a.astype(np.float32).astype(np.float64) for a in (positions, velocities, radii, preferred, fastest)]


def planes_of(crowd, i):
    """(n - 1, 4) half planes of agent i by all others, as neighbours that avoid it too."""
    positions, velocities, radii = crowd[:3]
    others = [j for j in range(len(positions)) if j != i]
    planes = np.zeros((len(others), 4))
    for row, j in enumerate(others):
        put_agent(
            planes, row, tuple(positions[j] - positions[i]), tuple(velocities[i]),
            tuple(velocities[i] - velocities[j]), radii[i] + radii[j], HORIZON, PERIOD, 0.5,
        )  # fmt: skip
    return planes


def rows_of(planes):
    """Outward normals (n, 2) and offsets (n,): a velocity v is permitted if normal . v <= offset."""
    exact = planes.astype(np.longdouble)
    normals = np.column_stack([exact[:, 3], -exact[:, 2]])
    normals /= np.hypot(normals[:, 0], normals[:, 1])[:, None]
    return normals, (normals * exact[:, :2]).sum(axis=1)


def on_circle(normals, offsets, fastest):
    """(k, 2) points where lines normal . v = offset cut the circle."""
    size = np.hypot(normals[:, 0], normals[:, 1])
    normals, offsets = normals[size > 0] / size[size > 0, None], offsets[size > 0] / size[size > 0]
    inside = fastest**2 - offsets**2
    n, b, half = normals[inside >= 0], offsets[inside >= 0], np.sqrt(inside[inside >= 0])[:, None]
    foot, along = n * b[:, None], np.column_stack([-n[:, 1], n[:, 0]])
    return np.vstack([foot + half * along, foot - half * along])


def corners(n1, b1, n2, b2):
    """(k, 2) points where the lines n1 . v = b1 and n2 . v = b2 cut, row by row."""
    det = n1[:, 0] * n2[:, 1] - n1[:, 1] * n2[:, 0]
    keep = det != 0.0
    x, y = b1 * n2[:, 1] - b2 * n1[:, 1], n1[:, 0] * b2 - n2[:, 0] * b1
    return np.column_stack([x[keep], y[keep]]) / det[keep, None]


def pairs(count):
    """Two arrays of the numbers of all pairs out of `count`."""
    found = np.array(list(combinations(range(count), 2)), dtype=np.int64).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def permitted(points, normals, offsets, fastest):
    """Those points that all half planes and the disc permit, up to the rounding of extended precision."""
    slack = np.longdouble(1.0e-16) * 1000
    inside = np.hypot(points[:, 0], points[:, 1]) <= fastest + slack
    return points[inside & (points @ normals.T <= offsets + slack).all(axis=1)]


def exact_nearest(planes, fastest, wanted):
    """The permitted velocity nearest to the wanted one, of all projections and corners; None where there is none."""
    normals, offsets = rows_of(planes)
    wanted = np.asarray(wanted, np.longdouble)
    first, second = pairs(len(planes))
    speed = np.hypot(*wanted)
    points = np.vstack([
        [wanted if speed <= fastest else wanted / speed * fastest],
        wanted + (offsets - normals @ wanted)[:, None] * normals,
        on_circle(normals, offsets, fastest),
        corners(normals[first], offsets[first], normals[second], offsets[second]),
    ])  # fmt: skip
    points = permitted(points, normals, offsets, fastest)
    return points[np.hypot(*(points - wanted).T).argmin()] if len(points) else None


def exact_least(planes, fastest, hard=0):
    """The velocity of least greatest violation, and this violation, m/s: the best of all that three conditions set."""
    normals, offsets = rows_of(planes)
    walls, edges, soft, beyond = normals[:hard], offsets[:hard], normals[hard:], offsets[hard:]
    first, second = pairs(len(soft))
    alike, level = soft[first] - soft[second], beyond[first] - beyond[second]
    points = [-fastest * soft, on_circle(alike, level, fastest), on_circle(walls, edges, fastest)]
    for k in range(hard):
        points.append(corners(np.tile(walls[k], (len(alike), 1)), np.full(len(alike), edges[k]), alike, level))
        points.append(corners(np.tile(walls[k], (hard, 1)), np.full(hard, edges[k]), walls, edges))
    third = np.array(list(combinations(range(len(soft)), 3)), dtype=np.int64).reshape(-1, 3)
    a, b, c = third.T
    points.append(corners(soft[a] - soft[b], beyond[a] - beyond[b], soft[a] - soft[c], beyond[a] - beyond[c]))
    inside = permitted(np.vstack(points), walls, edges, fastest)
    worst = (inside @ soft.T - beyond).max(axis=1)
    return inside[worst.argmin()], worst.min()
