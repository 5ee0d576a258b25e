"""The shipped configs give the traces that were recorded when a stream last changed on purpose."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

import pytest
from navloom.config import load_config
from navloom.study.episode import run_episode

TRACES = {
    "paper": "9e1efb2f77c545447296257dbec2bf3248e9479b757d685b3cfed07c1501eec7",
    "building": "dfbb68abdd852758b89c9ab4f279ff7fad89cefb83f5fd9871ab485c219230e3",
    "explore": "1fa6fb26e7d11677db5cc1f7385c7677ae60f6bb7625a0c3bafec546ab0abdf3",
}
"""SHA-256 of trace.bin by config, with its own seed. A change of one belongs in the changelog."""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="recorded on x86_64: other processors may round otherwise")
@pytest.mark.parametrize("config", TRACES)
def test_a_shipped_config_gives_the_recorded_trace(config: str) -> None:
    episode = run_episode(load_config(config))
    assert episode.summary()["truly_reached"]
    assert episode.log.trace_sha256 == TRACES[config]


SHA = """
from navloom.config import load_config
from navloom.study.episode import run_episode
print(run_episode(load_config("explore")).log.trace_sha256)
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="kernels of x86_64")
def test_the_trace_does_not_depend_on_the_kernels_that_openblas_chooses_for_the_processor() -> None:
    """Prescott's kernels have neither AVX nor fused products, which round differently."""
    plain = {**os.environ, "OPENBLAS_CORETYPE": "Prescott"}
    done = subprocess.run([sys.executable, "-c", SHA], env=plain, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == TRACES["explore"]
