"""Episodes of a study driven live, one after the other: each method in its processes, on the wall clock."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from navloom.config import Loaded
from navloom.config.schema import Config
from navloom.parts import part

from navloom_study.episode_rows import EpisodeTask, Row, lost_row, read_by_metrics, row_of
from navloom_study.study_worlds import placed

__all__ = ["NAME", "run_live"]

NAME = "compare"
"""Name of the robot that drives the episodes. Two live studies at once would slow each other: the second is refused."""


def run_live(
    tasks: Sequence[EpisodeTask],
    on_row: Callable[[Row], None],
    ending: threading.Event,
    say: Callable[[str], None] = lambda text: None,
    idle: Callable[[], None] = lambda: None,
) -> None:
    """Drive each episode live until its last goal has ended.

    Args:
        tasks: The episodes.
        on_row: Called with the row of each ended episode.
        ending: Set it to end the current robot and to leave.
        say: Receives what happens to the processes, with the episode.
        idle: Called several times a second.

    Raises:
        StartError: A robot does not start. KeyboardInterrupt: `ending` was set; the interrupted episode has no row.
    """
    LiveRun = part("navloom_live.drives.live_run", "--live").LiveRun
    StartError = part("navloom_live.hosting.live_robot").StartError
    for task in tasks:
        began, key = perf_counter(), task.key
        name = f"{key.method} in {key.world}, seed {key.seed}"
        loaded = _own_robot(placed(task.config, task.values, key.seed, Path(task.here)))
        run = LiveRun(loaded, None, False, lambda text, name=name: say(f"{name}: {text}"), ending,
                      reads=read_by_metrics(task))  # fmt: skip
        try:
            episode = run.run(True, progress=lambda *told: idle(), look=lambda robot: idle())
        except StartError as error:
            raise StartError(f"{name}: {error}") from None
        if ending.is_set():
            raise KeyboardInterrupt
        spent = perf_counter() - began
        on_row(lost_row(task, "no goal was driven", spent) if episode is None else row_of(task, episode, spent))


def _own_robot(loaded: Loaded) -> Loaded:
    """The config under the robot's name NAME, so that a robot of the user may be up at the same time."""
    tree = loaded.config.model_dump(mode="json", exclude_unset=True)
    tree["robot"] = {**tree.get("robot", {}), "name": NAME}
    return replace(loaded, config=Config.model_validate(tree))
