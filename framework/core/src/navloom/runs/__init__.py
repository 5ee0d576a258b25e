"""What a run is: an episode, what is recorded of it, its measures, and the folder with its results.

Begin with `episode.py`, `run_episode`; observers collect its data (`episode_recorder.py`) into a trail.
`metric_functions.py` computes metrics from it; `shadow_comparison.py` compares shadows with active instances.
`result_folder.py` writes `--out`. Lockstep, live and replayed runs all use this house.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom.runs.episode import Episode as Episode
    from navloom.runs.episode import run_episode as run_episode
    from navloom.runs.episode_trail import Trail as Trail
    from navloom.runs.metrics import METRICS as METRICS
    from navloom.runs.metrics import Metric as Metric
    from navloom.runs.result_folder import OutFolder as OutFolder
else:
    __all__, __getattr__ = lazy_names(
        "navloom.runs",
        {
            "navloom.runs.episode": "Episode run_episode",
            "navloom.runs.metrics": "METRICS Metric",
            "navloom.runs.result_folder": "OutFolder",
            "navloom.runs.episode_trail": "Trail",
        },
    )
