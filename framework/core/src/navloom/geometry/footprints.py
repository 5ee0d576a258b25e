"""The robot's outline: a convex polygon around the base frame's origin."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navloom.errors import NavloomError

__all__ = ["FootprintError", "circumscribed_radius", "disc", "inscribed_radius", "polygon", "rectangle"]

Floats = NDArray[np.float64]

_MAX_CORNERS = 64
_DISC_CORNERS = 32
_ROUNDING = 1e-9
"""Largest turn that counts as none, rad."""
_STRAIGHT = 1e-3
"""Largest distance of a corner from the line between its neighbours that is on it, m: one rounded to mm."""
_LARGEST = 100.0
"""Largest side and largest coordinate of a corner, m; larger ones are probably in millimetres."""


class FootprintError(NavloomError, ValueError):
    """An impossible footprint. The text says what was given and what was expected."""


def rectangle(length: float, width: float) -> Floats:
    """Corners of a rectangle centred on the base frame's origin.

    Args:
        length, width: Extent along x and along y, m, > 0, at most 100.

    Returns:
        (4, 2) m, base frame, counter-clockwise from the front left corner; read-only.

    Raises:
        FootprintError: A side is not a positive number, or too large.
    """
    for name, value in (("length", length), ("width", width)):
        # Negated, so that NaN is refused too.
        if not 0.0 < value <= _LARGEST:
            raise FootprintError(f"footprint {name} = {value}: expected a length > 0 in metres, at most {_LARGEST:g}")
    x, y = 0.5 * length, 0.5 * width
    outline = np.array([(x, y), (-x, y), (-x, -y), (x, -y)])
    outline.flags.writeable = False
    return outline


def disc(radius: float) -> Floats:
    """Corners of a regular polygon around a disc centred on the base frame's origin.

    Args:
        radius: m, > 0, at most 100; the polygon's inscribed radius. Its corners are 0.5 % farther away.

    Returns:
        (32, 2) m, base frame, counter-clockwise; read-only.

    Raises:
        FootprintError: The radius is not a positive number, or too large.
    """
    if not 0.0 < radius <= _LARGEST:
        raise FootprintError(f"footprint radius = {radius}: expected a length > 0 in metres, at most {_LARGEST:g}")
    angles = (np.arange(_DISC_CORNERS) + 0.5) * (2.0 * np.pi / _DISC_CORNERS)
    outline: Floats = radius / np.cos(np.pi / _DISC_CORNERS) * np.column_stack((np.cos(angles), np.sin(angles)))
    outline.flags.writeable = False
    return outline


def polygon(corners: ArrayLike) -> Floats:
    """A checked copy of a footprint's corners.

    Args:
        corners: (n, 2) m, base frame: convex, around the origin, in either direction, 3 to 64 corners, all within
            100 m of the axes. Corners on a straight edge, to 1 mm, are left out.

    Returns:
        (m, 2) float64, counter-clockwise, read-only.

    Raises:
        FootprintError: Anything else, naming the corner.
    """
    try:
        outline = np.array(corners, dtype=np.float64)
    except (TypeError, ValueError):
        raise FootprintError(f"footprint {corners!r}: expected corners as [[x, y], ...] in metres") from None
    if outline.ndim != 2 or outline.shape[1] != 2 or not 3 <= len(outline) <= _MAX_CORNERS:
        raise FootprintError(
            f"footprint of shape {outline.shape}: expected 3 to {_MAX_CORNERS} corners as [[x, y], ...] in metres"
        )
    if not np.isfinite(outline).all():
        raise FootprintError(f"footprint corner {_first(~np.all(np.isfinite(outline), axis=1))} is not finite")
    if (far := np.any(np.abs(outline) > _LARGEST, axis=1)).any():
        raise FootprintError(
            f"footprint corner {outline[_first(far)].tolist()}: expected metres, each at most {_LARGEST:g}"
        )
    if _is_clockwise(outline):
        outline = outline[::-1].copy()
    outline = _without_straight_corners(outline)
    _check_turns(outline)
    if _edge_distances(outline).min() <= 0.0:
        raise FootprintError(f"footprint {outline.tolist()} does not contain the base frame's origin (0, 0): shift it")
    outline.flags.writeable = False
    return outline


def _is_clockwise(outline: Floats) -> bool:
    """Whether the signed area is negative; meaningless for a self-crossing outline, which is refused anyway."""
    x, y = outline[:, 0], outline[:, 1]
    return bool((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() < 0.0)


def _without_straight_corners(outline: Floats) -> Floats:
    """The outline without corners at which it goes straight on, or turns right within `_STRAIGHT`."""
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    if not lengths.all():
        raise FootprintError(f"footprint corner {_first(lengths == 0.0)} is there twice: leave the second out")
    turns, forward = _turns(edges)
    chords = edges + np.roll(edges, -1, axis=0)
    is_near = -turns <= _STRAIGHT * np.hypot(chords[:, 0], chords[:, 1])
    # A left turn of an exactly straight edge is rounding; a larger one may be a corner of a fine round outline.
    is_right = turns <= _ROUNDING * lengths * np.roll(lengths, -1)
    kept: Floats = outline[~np.roll(is_near & is_right & (forward > 0.0), 1)]
    return kept if len(kept) >= 3 else outline


def _turns(edges: Floats) -> tuple[Floats, Floats]:
    """(n,) cross and dot product of each edge with the next, m²."""
    following = np.roll(edges, -1, axis=0)
    return edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0], (edges * following).sum(axis=1)


def _check_turns(outline: Floats) -> None:
    turns, forward = _turns(np.roll(outline, -1, axis=0) - outline)
    total = np.arctan2(turns, forward).sum()
    # An outline that turns left everywhere but winds around twice is a star, not convex.
    if (turns <= 0.0).any() or not np.isclose(total, 2.0 * np.pi):
        place = (_first(turns <= 0.0) + 1) % len(outline) if (turns <= 0.0).any() else 0
        raise FootprintError(
            f"footprint is not convex at the corner {outline[place].tolist()}, or crosses itself: "
            "expected corners in order around a convex outline; give the convex hull"
        )


def _first(wrong: NDArray[np.bool_]) -> int:
    return int(np.argmax(wrong))


def _edge_distances(outline: Floats) -> Floats:
    """(n,) signed distance of the origin from each edge's line, m, positive inside."""
    edges = np.roll(outline, -1, axis=0) - outline
    return (outline[:, 0] * edges[:, 1] - outline[:, 1] * edges[:, 0]) / np.hypot(edges[:, 0], edges[:, 1])


def inscribed_radius(footprint: Floats) -> float:
    """Radius of the largest disc around the origin within the footprint, m. `footprint`: as returned by `polygon`."""
    return float(_edge_distances(footprint).min())


def circumscribed_radius(footprint: Floats) -> float:
    """Radius of the smallest disc around the origin that covers the footprint, m; `footprint`: from `polygon`."""
    return float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
