"""Describes a run for observers."""

from __future__ import annotations

from typing import Literal

from navloom.config import Loaded
from navloom.plugins import RunInfo

__all__ = ["run_info"]


def run_info(loaded: Loaded, kind: Literal["lockstep", "barrier", "live"]) -> RunInfo:
    """Description of a run of this config, for observers."""
    config = loaded.config
    return RunInfo(
        kind, loaded.name, config.model_dump(mode="json"), loaded.sha256(), config.robot.realm, config.robot.name,
        config.run.seed,
    )  # fmt: skip
