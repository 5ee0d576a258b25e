"""Studies: methods x worlds x seeds under equal conditions, with paired statistics and a report.

Begin with `compare.py`, `run_study`; `study_request.py` is the study as data, `episode_rows.py` one episode of it.
`statistics.py` compares methods, `paired_differences.py` tests their differences, and `verdict.py` says the result in
sentences; `binomial.py`, `resampling.py` and `sign_flips.py` hold the mathematics, arrays in and numbers out.
Episodes run on `worker_pool.py`; a plugin that fails loses only its own episode.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom.runs.episode_trail import Trail as Trail
    from navloom.runs.metrics import METRICS as METRICS
    from navloom.runs.metrics import Metric as Metric

    from navloom_study.compare import plan_study as plan_study
    from navloom_study.compare import run_study as run_study
    from navloom_study.statistics import compare_methods as compare_methods
else:
    __all__, __getattr__ = lazy_names(
        "navloom_study",
        {
            "navloom.runs.metrics": "METRICS Metric",
            "navloom.runs.episode_trail": "Trail",
            "navloom_study.compare": "plan_study run_study",
            "navloom_study.statistics": "compare_methods",
        },
    )
