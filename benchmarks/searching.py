"""Time and memory of the search over a whole map, and time of the particle filter.

    python benchmarks/searching.py [WORLD …] [--scans 50] [--hidden 0.5] [--particles 500,5000] [--json]

A world is a reference as in a config, as `rosmap:map.yaml` or `floor:1?size=100x100`. Scans of 361 beams over 270° and
10 m are made at random free places; a share of their beams may end on something that the map lacks. Times are those
of the processor, so that other programs hardly count.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from navloom.engine.build import grid_of
from navloom.messages import OccupancyGrid
from navloom.plugins.discovery import Discovery
from navloom_mcl import filter as particle_filter
from navloom_mcl.filter import FilterSettings, ParticleFilter
from navloom_mcl.params import MclParams
from navloom_scans import anywhere
from navloom_scans.anywhere import MapSearch
from navloom_scans.field import DistanceField
from navloom_scans.maps import field_of_map, free_of_map
from numpy.typing import NDArray

__all__ = ["filter_times", "scan_at", "search_times"]

Floats = NDArray[np.float64]

BEARINGS = np.radians(np.linspace(-135.0, 135.0, 361))
RANGE, SIGMA = 10.0, 0.01
"""Range of the laser and its noise, m."""
ROOM = 0.35
"""Least distance of the robot from a wall, m."""
HIDDEN_BEAMS = 30
"""Beams that one unmapped thing hides."""
CELL, HEIGHT = 0.05, 0.6
"""Cells of the map of a world that has none, and height of the robot, m."""
PLACES = 40
"""Places that a search returns at most."""


def scan_at(field: DistanceField, place: Floats, hidden: float, stream: np.random.Generator) -> tuple[Floats, int]:
    """Beams, as those of a localizer, from a place (3,): from node to node by the distance to the nearest wall."""
    x, y, (c, s, spacing) = place[0], place[1], field.frame[2:]
    ways = np.column_stack((np.cos(BEARINGS + place[2]), np.sin(BEARINGS + place[2])))
    ranges, is_done = np.zeros(len(BEARINGS)), np.zeros(len(BEARINGS), dtype=np.bool_)
    while not is_done.all():
        px, py = x + ranges * ways[:, 0] - field.frame[0], y + ranges * ways[:, 1] - field.frame[1]
        column, row = np.rint((c * px + s * py) / spacing).astype(int), np.rint((c * py - s * px) / spacing).astype(int)
        rows, columns = field.values.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        distance = np.where(inside, field.values[row.clip(0, rows - 1), column.clip(0, columns - 1)], RANGE)
        is_done |= (distance < 0.5 * spacing) | (ranges > RANGE)
        ranges += np.where(is_done, 0.0, np.maximum(distance - 0.5 * spacing, 0.5 * spacing))
    ranges += stream.normal(0.0, SIGMA, len(ranges))
    is_hidden = np.zeros(len(ranges), dtype=np.bool_)
    while is_hidden.mean() < hidden:
        first = stream.integers(len(ranges))
        is_hidden[first : first + HIDDEN_BEAMS] = True
        ranges[first : first + HIDDEN_BEAMS] = np.minimum(
            ranges[first : first + HIDDEN_BEAMS], stream.uniform(0.5, 2.5)
        )
    heard = ranges < RANGE
    ranges[~heard] = 0.9 * RANGE
    ahead = np.column_stack((np.cos(BEARINGS), np.sin(BEARINGS)))
    rows = np.hstack((ranges[:, None] * ahead, ahead))
    return np.concatenate((rows[heard], rows[~heard])), int(heard.sum())


def search_times(grid: OccupancyGrid, scans: int, hidden: float) -> dict[str, Any]:
    """Seconds and memory of the searches for scans at random places of a map, and how many were found."""
    anywhere.warm_up()
    reading, stream = MclParams(), np.random.default_rng(0)
    begin = time.process_time()
    field = field_of_map(grid, reading)
    middle = time.process_time()
    search = MapSearch(field, free_of_map(grid, reading))
    end = time.process_time()
    free = np.argwhere(field.values[1::2, 1::2] > ROOM)
    seconds, first, among, complete, most = [], 0, 0, 0, 0
    for row, column in free[stream.integers(len(free), size=scans)]:
        u, v, f = (column + 0.5) * grid.resolution, (row + 0.5) * grid.resolution, field.frame
        place = np.array([f[0] + f[2] * u - f[3] * v, f[1] + f[3] * u + f[2] * v, stream.uniform(-math.pi, math.pi)])
        scan = scan_at(field, place, hidden, stream)
        since = time.process_time()
        poses, _ = search.search(*scan, PLACES)
        seconds.append(time.process_time() - since)
        off = np.hypot(poses[:, 0] - place[0], poses[:, 1] - place[1])
        turned = np.abs(np.remainder(poses[:, 2] - place[2] + math.pi, math.tau) - math.pi)
        right = (off < 0.2) & (turned < math.radians(5.0))
        first, among = first + bool(right[:1].any()), among + bool(right.any())
        complete, most = complete + search.is_complete, max(most, search.bytes)
    return {
        "cells": grid.cells.shape, "field_s": middle - begin, "field_mb": field.values.nbytes / 1e6,
        "pyramid_s": end - middle, "search_mb": most / 1e6, "median_s": float(np.median(seconds)),
        "most_s": max(seconds), "first": first, "among": among, "complete": complete, "scans": scans,
    }  # fmt: skip


def filter_times(grid: OccupancyGrid, particles: int) -> dict[str, float]:
    """Microseconds of a prediction, of a correction by a scan of 361 beams, and of the hypotheses; medians of 100."""
    particle_filter.warm_up()
    field, stream = field_of_map(grid, MclParams()), np.random.default_rng(0)
    row, column = stream.permutation(np.argwhere(field.values[1::2, 1::2] > 2.0 * ROOM))[0]
    u, v = (column + 0.5) * grid.resolution, (row + 0.5) * grid.resolution
    f = field.frame
    place = np.array([f[0] + f[2] * u - f[3] * v, f[1] + f[3] * u + f[2] * v, 0.3])
    scan = scan_at(field, place, 0.3, stream)
    belief = ParticleFilter(field, FilterSettings(least=particles, most=particles), np.random.default_rng(1))
    belief.spread(place[None, :], np.diag([0.05**2, 0.05**2, 0.03**2]))
    rows = []
    for _ in range(100):
        times = [time.process_time()]
        belief.predict(np.zeros(3), 0.05)
        times.append(time.process_time())
        belief.correct(*scan)
        times.append(time.process_time())
        belief.hypotheses()
        times.append(time.process_time())
        rows.append(np.diff(times))
    predict, correct, places = (1e6 * np.median(rows, axis=0)).tolist()
    return {"predict_us": predict, "correct_us": correct, "hypotheses_us": places}


def main(arguments: list[str]) -> None:
    """Print the figures of each world."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", default=["floor:1"])
    parser.add_argument("--scans", type=int, default=50)
    parser.add_argument("--hidden", type=float, default=0.0)
    parser.add_argument("--particles", default="500,5000")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(arguments)
    discovery, found = Discovery(), {}
    for reference in given.worlds:
        grid = grid_of(discovery.world(reference, Path()), CELL, HEIGHT)
        found[reference] = search_times(grid, given.scans, given.hidden)
    grid = grid_of(discovery.world(given.worlds[0], Path()), CELL, HEIGHT)
    times = {count: filter_times(grid, count) for count in map(int, given.particles.split(","))}
    if given.json:
        print(json.dumps({"search": found, "filter": times}))
        return
    for reference, row in found.items():
        print(
            f"{reference}: {row['cells']} cells; field {row['field_s']:.2f} s, {row['field_mb']:.0f} MB; "
            f"pyramid {row['pyramid_s']:.2f} s; search {row['median_s']:.3f} s, at most {row['most_s']:.3f} s, "
            f"{row['search_mb']:.0f} MB; right {row['first']} first, {row['among']} among {PLACES}, "
            f"complete {row['complete']}, of {row['scans']}"
        )
    for count, row in times.items():
        print(f"{count} particles: " + ", ".join(f"{name} {value:.0f}" for name, value in row.items()))


if __name__ == "__main__":
    main(sys.argv[1:])
