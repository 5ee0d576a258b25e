"""The shipped configs give the traces that were recorded when a stream last changed on purpose."""

from __future__ import annotations

import platform

import pytest
from navloom.config import load_config
from navloom.study.episode import run_episode

TRACES = {
    "paper": "0a11c854d4c703d2388cd84130d8dd90522336ba2a39c2d743b03c132f4b58f9",
    "building": "b448e57e8388449112e07790d5615d2e498d2104cf5d1b074df040f2c9fae626",
    "explore": "635cc53a4ca962221a6989dd188a1968a73452d89ef50b30ca571ba35c72e91d",
}
"""SHA-256 of trace.bin by config, with its own seed. A change of one belongs into the changelog."""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="recorded on x86_64: other processors may round otherwise")
@pytest.mark.parametrize("config", TRACES)
def test_a_shipped_config_gives_the_recorded_trace(config: str) -> None:
    episode = run_episode(load_config(config))
    assert episode.summary()["truly_reached"]
    assert episode.log.trace_sha256 == TRACES[config]
