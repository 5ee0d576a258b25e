"""Drives of many seeds: how often the robot truly reaches D, and how it gets there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from navloom.config import load_config
from navloom.runs import run_episode
from numpy.typing import NDArray

__all__ = [
    "LEVELS",
    "PARAMETERS",
    "SEEDS",
    "Calibration",
    "Result",
    "Tally",
    "calibrations",
    "driven",
    "steps_of_campaigns",
]

Floats = NDArray[np.float64]
SEEDS = range(20)
"""Seeds of every campaign."""
LEVELS = (-0.10, -0.05, -0.02, -0.01, 0.0, 0.01, 0.02, 0.05, 0.10)
"""True value of a robot parameter divided by the nominal one, minus 1."""
PARAMETERS = (("wheel radius", "wheel_radius_error"), ("half track", "half_track_error"))
"""Name for people, and key of `sensors_sim`."""
TRUE_ODOMETRY = {
    "wheel_radius_error": ("odometry_right_radius_error", "odometry_left_radius_error"),
    "half_track_error": ("odometry_half_track_error",),
}
"""Keys with which odometry knows the true value of a parameter, although the controller does not."""
ROOM = "world.ref=paper_gates"


@dataclass(frozen=True, eq=False)
class Result:
    """One drive.

    Attributes:
        seed: Its seed.
        believed: Whether the robot says that it reached D.
        reached: Whether it truly did.
        goal_error: True distance from D at the end, m.
        contacts: Number of contacts.
        clearance: Least true distance between robot and obstacles, m.
        time: Robot time, s.
        track: (n, 4) time, s; true x, y, m, map frame; distance to the nearest obstacle, m.
    """

    seed: int
    believed: bool
    reached: bool
    goal_error: float
    contacts: int
    clearance: float
    time: float
    track: Floats


@dataclass(frozen=True, eq=False)
class Tally:
    """The drives of one reading.

    Attributes:
        name: Name of the reading, for people.
        settings: Differences from the config `paper`, in the form of `--set`.
        results: One for each seed.
    """

    name: str
    settings: tuple[str, ...]
    results: tuple[Result, ...]

    @property
    def reached(self) -> int:
        """Number of drives that truly reached D."""
        return sum(result.reached for result in self.results)

    @property
    def believed(self) -> int:
        """Number of drives in which the robot says that it reached D."""
        return sum(result.believed for result in self.results)

    @property
    def touched(self) -> int:
        """Number of drives with a contact."""
        return sum(result.contacts > 0 for result in self.results)

    def median(self, name: str) -> float:
        """Median of a field of `Result`."""
        return float(np.median([getattr(result, name) for result in self.results]))


@dataclass(frozen=True, eq=False)
class Calibration:
    """Drives with one wrong robot parameter.

    Attributes:
        parameter: Name for people.
        error: True value divided by the one that the robot assumes, minus 1.
        knows: Whether odometry knows the true value. The controller never does.
        tally: The drives.
    """

    parameter: str
    error: float
    knows: bool
    tally: Tally


def driven(name: str, *settings: str, seeds: range = SEEDS) -> Tally:
    """Drive the shipped config `paper` with overrides, once for each seed."""
    return Tally(name, settings, tuple(_result(seed, settings) for seed in seeds))


def _result(seed: int, settings: tuple[str, ...]) -> Result:
    episode = run_episode(load_config("paper", settings, seed))
    found = episode.summary()
    return Result(
        seed,
        found["outcome"] == "succeeded",
        bool(found["truly_reached"]),
        float(found["goal_error_m"]),
        int(found["collisions"]),
        float(found["min_clearance_m"]),
        float(found["sim_time_s"]),
        np.array(episode.recorder.truth)[:, [0, 1, 2, 5]],
    )


def steps_of_campaigns() -> int:
    """Number of calls of `say` by `calibrations`."""
    return len(PARAMETERS) * len(LEVELS) * 2


def calibrations(say: Callable[[str], None], seeds: range = SEEDS) -> tuple[Calibration, ...]:
    """Drives without the obstacle O with a wheel radius or a half track that differ from those of `[robot]`.

    Once odometry has the same wrong value as the controller, once it has the true one, so that only the controller's
    commands are wrong.
    """
    found = []
    for parameter, key in PARAMETERS:
        for knows in (False, True):
            for error in LEVELS:
                keys = (key, *(TRUE_ODOMETRY[key] if knows else ()))
                name = f"{parameter} {100.0 * error:+g} %{', known to odometry' if knows else ''}"
                say(name)
                settings = (ROOM, *(f"platform.{key}={error:g}" for key in keys))
                found.append(Calibration(parameter, error, knows, driven(name, *settings, seeds=seeds)))
    return tuple(found)
