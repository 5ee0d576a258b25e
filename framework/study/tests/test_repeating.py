"""An episode run twice in one process: the first stream that differs is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom import Avoidance, AvoiderInput
from navloom_study.repeat_check import run_twice
from toys import Bystander, blamed, discovery, toy_config

Turn = Callable[[], float]


def by_numpy() -> float:
    return float(np.random.random())  # noqa: NPY002


def twice(folder: Path, turn: Turn, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Two runs of an avoider whose turn rate is 1e-9 rad/s times what a function gives in each step."""
    avoid = Bystander.avoid

    def drifts(self: Bystander, given: AvoiderInput) -> Avoidance:
        right = avoid(self, given)
        return replace(right, twist=replace(right.twist, wz=1e-9 * turn()))

    monkeypatch.setattr(Bystander, "avoid", drifts)
    return run_twice(toy_config(folder, "run.stop_after=1.0", "avoider.name=left"), discovery())


def test_the_first_stream_in_which_two_runs_differ_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, divergence, seen = twice(tmp_path, by_numpy, monkeypatch)
    where = (divergence.role, divergence.instance, divergence.plugin, divergence.port)
    assert where == ("avoider", "left", "toy_bystander", "command")
    assert divergence.tick < 10 and "command.twist.wz: " in divergence.text
    assert [one.kind for one in seen] == ["random"]


def test_state_that_outlives_an_episode_makes_the_second_differ(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[int] = []

    def counts() -> int:
        steps.append(1)
        return len(steps)

    _, divergence, seen = twice(tmp_path, counts, monkeypatch)
    assert divergence.role == "avoider" and seen == []


def test_an_episode_of_good_plugins_is_the_same_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    episode, divergence, seen = twice(tmp_path, lambda: 0.0, monkeypatch)
    assert (divergence, seen, blamed(episode)) == (None, [], [])
