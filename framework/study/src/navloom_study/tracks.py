"""The driven track of each episode of a study, thinned so that reports can draw thousands of them.

There is one file an episode, `trails/METHOD,WORLD,SEED.npz`, with the same bytes on every run and machine.
"""

from __future__ import annotations

import hashlib
import io
import math
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from navloom.inputs.npz import Arrays
from navloom.runs.episode_trail import Trail
from navloom.runs.shadow_comparison import Disagreement
from numpy.typing import NDArray

from navloom_study.episode_key import EpisodeKey

__all__ = ["FOLDER", "StoredWay", "encoded", "encoded_together", "file_of", "read_track"]

Floats = NDArray[np.float64]

# One file each and not the journal or one archive: written in any order and by any later run, and a report reads only
# those that it draws.
FOLDER = "trails"
SAMPLES = 256
"""Most points of one track: a drive of two minutes has one every half second."""
MILLI = 1e-3
"""Resolution of stored values: 1 mm, 1 ms, 1 mm/s and 1 mrad/s."""
LONGEST_NAME = 120
EPOCH = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, eq=False)
class StoredWay:
    """A stored track.

    Attributes:
        time: (n,) run clock, s.
        points: (n, 2) true positions, m, map frame.
        engaged: (n,) whether the avoider drives.
        goal: (2,) goal, m, map frame, or None.
        tolerance: Tolerance of the goal, m.
        shadow_time: (k,) s, by "instance quantity" of a shadow.
        shadow: (k,) difference from the active instance, by the same name.
        others: Of a fleet, the tracks of the further members.
    """

    time: Floats
    points: Floats
    engaged: NDArray[np.bool_]
    goal: Floats | None = None
    tolerance: float = 0.0
    shadow_time: dict[str, Floats] = field(default_factory=dict)
    shadow: dict[str, Floats] = field(default_factory=dict)
    others: tuple[StoredWay, ...] = ()

    @property
    def is_there(self) -> bool:
        """Whether it ends within the goal's tolerance."""
        return self.goal is not None and math.dist(self.points[-1], self.goal) <= self.tolerance


def file_of(key: EpisodeKey) -> str:
    """Name of an episode's file: its key if that is a valid file name everywhere, else a cleaned key with a hash."""
    told = f"{key.method},{key.world},{key.seed}"
    plain = re.sub(r"[^A-Za-z0-9_.=+,-]", "_", told)[:LONGEST_NAME]
    if plain != told or plain.startswith("."):
        plain = f"_{plain},{hashlib.sha256(told.encode()).hexdigest()[:8]}"
    return f"{plain}.npz"


def encoded(
    trail: Trail,
    goal: tuple[float, float] | None,
    tolerance: float,
    shadows: Sequence[Disagreement] = (),
) -> bytes:
    """Contents of an episode's file; empty for a trail without ticks."""
    arrays = _arrays(trail, goal, tolerance)
    if not arrays:
        return b""
    for one in shadows:
        for name, values in one.values.items():
            told = np.array(values, dtype=np.float64)
            if np.any(told[~np.isnan(told)] != 0.0):
                known = ~np.isnan(told)
                arrays[f"shadow {one.instance} {name} ms"] = _whole(np.array(one.times)[known], np.int32)
                arrays[f"shadow {one.instance} {name}"] = _whole(told[known], np.int32)
    return _npz(arrays)


def encoded_together(ways: Sequence[tuple[Trail, tuple[float, float] | None, float]]) -> bytes:
    """Contents of the file of a fleet's episode.

    Args:
        ways: Of each member its trail, its goal and the goal's tolerance, as for `encoded`.
    """
    held = [found for way in ways if (found := _arrays(*way))]
    return _npz({name if k == 0 else f"{k} {name}": array for k, own in enumerate(held) for name, array in own.items()})


def _arrays(trail: Trail, goal: tuple[float, float] | None, tolerance: float) -> dict[str, NDArray[np.generic]]:
    """The arrays of one thinned track; none for a trail without ticks."""
    count = trail.time.size
    if not count:
        return {}
    every = math.ceil(count / SAMPLES)
    kept = np.unique(np.append(np.arange(0, count, every), count - 1))
    arrays: dict[str, NDArray[np.generic]] = {
        "time_ms": _whole(trail.time[kept], np.int32),
        "points_mm": _whole(np.column_stack([trail.x[kept], trail.y[kept]]), np.int32),
        "engaged": trail.engaged[kept],
    }
    if goal is not None:
        arrays["goal_mm"] = _whole(np.array([*goal, tolerance]), np.int32)
    return arrays


def read_track(folder: Path, key: EpisodeKey) -> StoredWay | None:
    """An episode's track; None if none was stored or the file is not valid."""
    try:
        held = Arrays(folder / FOLDER / file_of(key), ValueError)
        arrays = {name: held.read(name) for name in held.names}
        told = [name for name in arrays if name.startswith("shadow ") and not name.endswith(" ms")]
        count = sum(name.endswith(" points_mm") for name in arrays)
        return replace(
            _way(arrays, ""),
            shadow_time={name.removeprefix("shadow "): arrays[f"{name} ms"] * MILLI for name in told},
            shadow={name.removeprefix("shadow "): arrays[name] * MILLI for name in told},
            others=tuple(_way(arrays, f"{number} ") for number in range(1, count + 1)),
        )
    except (OSError, ValueError, KeyError, IndexError):
        return None


def _way(arrays: Mapping[str, NDArray[Any]], prefix: str) -> StoredWay:
    goal = arrays[f"{prefix}goal_mm"] * MILLI if f"{prefix}goal_mm" in arrays else None
    return StoredWay(
        arrays[f"{prefix}time_ms"] * MILLI,
        arrays[f"{prefix}points_mm"] * MILLI,
        arrays[f"{prefix}engaged"].astype(np.bool_),
        None if goal is None else goal[:2],
        0.0 if goal is None else float(goal[2]),
    )


def _whole(values: Floats, kind: type[np.int32]) -> NDArray[np.generic]:
    return np.clip(np.rint(values / MILLI), np.iinfo(kind).min, np.iinfo(kind).max).astype(kind)


def _npz(arrays: dict[str, NDArray[np.generic]]) -> bytes:
    """Like `np.savez_compressed`, but without time stamps."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array, allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", EPOCH)
            entry.create_system = 3
            archive.writestr(entry, member.getvalue(), zipfile.ZIP_DEFLATED, 9)
    return buffer.getvalue()
