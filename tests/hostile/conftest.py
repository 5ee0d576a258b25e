"""Makes this folder's modules importable by its tests, and imports once what the commands import."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session", autouse=True)
def warm() -> None:
    """Import what the commands import, so that children measure the file and not the imports."""
    import navloom.engine.build
    import navloom_ros.bag_import
    import navloom_study.recorded_sweeps
    import navloom_study.report.study_files
    import rosbags.highlevel
    import yaml
    from navloom.config import load_config
    from PIL import PngImagePlugin

    assert navloom_ros.bag_import and navloom_study.report.study_files and navloom_study.recorded_sweeps
    assert rosbags.highlevel and yaml and PngImagePlugin
    navloom.engine.build.assemble(load_config("paper"))  # imports the plugins
