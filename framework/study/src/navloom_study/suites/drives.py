"""Pictures of a typical and of the worst drive of each method in a suite."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from navloom_study.suites.result_file import SuiteResult
from navloom_study.suites.suite_run import SuitePlan

__all__ = ["pictures_of"]


def pictures_of(folder: Path, plan: SuitePlan, result: SuiteResult) -> Mapping[str, bytes]:
    return {}
