"""The shipped configs give the traces that were recorded when a stream last changed on purpose."""

from __future__ import annotations

import platform

import pytest
from navloom.config import load_config
from navloom.study.episode import run_episode

TRACES = {
    "paper": "0d3cff2baa2e6c887e1b265521182e5c098ee21ec709d7f9dc7f1b5436178d74",
    "building": "e77f509737e4814140cc3707a80dd26bc116527c9e1040d686c0482c7c971c43",
    "explore": "759ba63d9f58a07fce8eb54c0a8e6d35b79425b447057c6e84239c15d03afa1d",
}
"""SHA-256 of trace.bin by config, with its own seed. A change of one belongs in the changelog."""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="recorded on x86_64: other processors may round otherwise")
@pytest.mark.parametrize("config", TRACES)
def test_a_shipped_config_gives_the_recorded_trace(config: str) -> None:
    episode = run_episode(load_config(config))
    assert episode.summary()["truly_reached"]
    assert episode.log.trace_sha256 == TRACES[config]
