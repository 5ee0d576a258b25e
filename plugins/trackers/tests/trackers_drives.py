"""Drives in lockstep on the simulated robot along given paths, on an empty floor; no avoider takes over."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from navloom import OccupancyGrid, Path, Planner, PlannerInput, Pose2D, World
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import lockstep_of
from navloom.engine.plugin_factory import make_plugins
from navloom.runs.episode_recorder import Recorder
from navloom.runs.episode_trail import trail_of
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def line() -> Floats:
    """(n, 2) 6 m along the x axis."""
    return np.array([[0.0, 0.0], [6.0, 0.0]])


def circle(radius: float = 1.5) -> Floats:
    """(n, 2) five sixths of a circle to the left, m."""
    turn = np.linspace(0.0, 2.0 * math.pi * 5.0 / 6.0, 40)
    return radius * np.column_stack((np.sin(turn), 1.0 - np.cos(turn)))


def figure_eight(size: float = 3.0) -> Floats:
    """(n, 2) 80 % of a lemniscate of Gerono, m: turns both ways and crosses itself."""
    turn = np.linspace(0.0, 0.8 * 2.0 * math.pi, 100)
    return size * np.column_stack((np.cos(turn), np.sin(turn) * np.cos(turn)))


def corners() -> Floats:
    """(n, 2) right angles to the left and to the right, 2 m apart after the first 4 m."""
    return np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [6.0, 2.0], [6.0, 4.0], [4.0, 4.0], [4.0, 6.0]])


def narrow_turns() -> Floats:
    """(n, 2) lanes of 4 m to and fro, 0.8 m apart."""
    return np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 0.8], [0.0, 0.8], [0.0, 1.6], [4.0, 1.6]])


PATHS = {"line": line, "circle": circle, "figure_eight": figure_eight}
BENDS = {"corners": corners, "narrow_turns": narrow_turns}


class GivenPath(Planner):
    """Answers every request with the same path."""

    name = "given_path"

    def __init__(self, points: Floats) -> None:
        self.points = points

    def plan(self, given: PlannerInput) -> Path:
        length = float(np.hypot(*np.diff(self.points, axis=0).T).sum())
        return Path(given.request.request_id, self.points, length, None)


@dataclass(frozen=True)
class Drive:
    """Results of a drive.

    Attributes:
        outcome: Outcome of the goal by ground truth.
        seconds: Duration, s.
        rms, most: RMS and largest cross-track error of the real robot after the first 3 m, m.
        outside: Largest distance of the real robot to the outer side of the last bend of its path, m.
        track: (n, 5) time, s, true x, y, m, heading, rad, and speed, m/s.
    """

    outcome: str
    seconds: float
    rms: float
    most: float
    outside: float
    track: Floats


def drive(
    tracker: str,
    path: str,
    params: Sequence[str] = (),
    radius_error: float = 0.0,
    track_error: float = 0.0,
    beside: float = 0.0,
    turned_deg: float = 0.0,
    settings: Sequence[str] = (),
) -> Drive:
    """Drive the paper's robot: 0.5 m/s, 25 deg/s, reference at 0.2 to 0.4 m/s.

    Its wheels and track differ from their nominal values by the errors. Its pose is exact: odometry is calibrated and
    without slip.

    Args:
        tracker: Name of the plugin.
        path: Key of PATHS or BENDS.
        params: TOML assignments to the controller's table.
        radius_error, track_error: True value over nominal value, minus 1.
        beside: Start this far to the left of the path, m.
        turned_deg: Start turned from the path by this angle, degrees.
        settings: Further settings of the config.
    """
    points = (PATHS | BENDS)[path]()
    ahead = math.atan2(*(points[1] - points[0])[::-1])
    x, y = points[0] + beside * np.array([-math.sin(ahead), math.cos(ahead)])
    errors = f"noise=false,wheel_radius_error={radius_error},half_track_error={track_error}"
    known = f"odometry_right_radius_error={radius_error},odometry_left_radius_error={radius_error}"
    system = assemble(
        load_config(
            "paper",
            [
                "run.stop_after=240.0",
                'world.ref="empty"',
                f"navigation.start={{x={x},y={y},heading_deg={math.degrees(ahead) + turned_deg}}}",
                f"navigation.goal={{x={points[-1, 0]},y={points[-1, 1]}}}",
                'navigation.handover="never"',
                'sensor=[{name="sonars",kind="sonar_ring"}]',
                'mapper={plugin="known_map"}',
                f'platform={{plugin="sensors_sim",{errors},{known},odometry_half_track_error={track_error}}}',
                f"controller={{{','.join([f'plugin={tracker!r}', *params])}}}",
                *settings,
            ],
        )
    )
    system.world = World("floor", bounds=(-9.0, -9.0, 9.0, 9.0))
    system.map = OccupancyGrid(np.zeros((18, 18), np.int8), 1.0, Pose2D(-9.0, -9.0, 0.0))  # paths start beside it
    make_plugins(system)
    planner = system.parts[("planner", system.config.planner.instance)]
    planner.plugin = GivenPath(points)
    recorder = Recorder()
    log = lockstep_of(system, [recorder]).run(4802)
    (result,) = log.results
    track = np.array(recorder.truth)[:, :5]
    samples = recorder.trajectories[0].samples
    left, chords = cross_tracks(samples, track[:, 1:3])
    off = np.abs(left)
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(track[:, 1:3], axis=0).T))))
    settled = off[driven >= 3.0]
    outcome, seconds = trail_of(system, recorder, log, result).outcome, float(track[-1, 0])
    outside = max(0.0, float((-left * last_bend(samples)[chords]).max()))
    return Drive(outcome, seconds, math.sqrt(float((settled**2).mean())), float(settled.max()), outside, track)


def cross_tracks(samples: Floats, points: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """(n,) distance, m, of points (n, 2) to the left of the nearest chord of a trajectory (k, 6), and its number."""
    start, along = samples[:-1, 1:3], np.diff(samples[:, 1:3], axis=0)
    square = (along**2).sum(axis=1)
    left, chords = [], []
    for point in points:
        share = (((point - start) * along).sum(axis=1) / square).clip(0.0, 1.0)
        apart = point - start - share[:, None] * along
        gaps = np.hypot(*apart.T)
        k = int(np.argmin(gaps))
        chords.append(k)
        left.append(math.copysign(gaps[k], along[k, 0] * apart[k, 1] - along[k, 1] * apart[k, 0]))
    return np.array(left), np.array(chords, np.intp)


def last_bend(samples: Floats) -> Floats:
    """(k - 1,) side to which the path last turned at each chord of a trajectory (k, 6): 1 left, -1 right, 0 not yet."""
    sides = [0.0]
    for curvature in samples[:-1, 4]:
        sides.append(math.copysign(1.0, curvature) if abs(curvature) > 1e-6 else sides[-1])
    return np.array(sides[1:])
