"""`navloom check`: what every plugin must pass, each check in a process that the plugin cannot harm.

Begin with `checks.py`, which says how to add a check, then `tiers.py`, all checks in order.
`runner.py` starts the worker process, `check_bench.py` plays scenes under known conditions, `findings.py` reports.
`hardware_check.py` checks a real platform; `pytest_plugin.py` runs the checks as tests of a distribution.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom_check.builders import *  # noqa: F403
    from navloom_check.messages import *  # noqa: F403
    from navloom_check.runner import check_plugin as check_plugin
    from navloom_check.samples import *  # noqa: F403
    from navloom_check.scenes import *  # noqa: F403
else:
    __all__, __getattr__ = lazy_names(
        "navloom.testing",
        {
            "navloom_check.builders": (
                "avoider_input context controller_input extras localizer_input make mapper_input planner_input "
                "platform_input recovery_input robot"
            ),
            "navloom_check.messages": "empty_diagnostics estimate map_update pose scan sweep track trajectory",
            "navloom_check.runner": "check_plugin",
            "navloom_check.samples": "sample",
            "navloom_check.scenes": "box cast closed corridor door grid open_floor room wall_ahead",
        },
    )
