"""Round trips over the bus relative to raw Zenoh and dora-rs, measured in the same run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

WIRE = Path(__file__).parents[1] / "wire.py"
ZENOH_SHARE, DORA_SHARE = 1.3, 0.5
AT_110_KB = ("sweep 110 KB", "map 110 KB")


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, str(WIRE), "--json"], capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    made: dict[str, Any] = json.loads(done.stdout)
    return made


def ratio(found: dict[str, Any], message: str, peer: str) -> float:
    entry = next(row for row in found["rows"] if row["message"] == message)
    if peer not in entry["ratios"]:
        pytest.skip(found["skipped"].get(peer, f"{peer} was not measured"))
    return float(entry["ratios"][peer]["median"])


@pytest.mark.benchmark
@pytest.mark.parametrize("message", AT_110_KB)
def test_a_round_trip_costs_little_more_than_the_bare_bytes(found: dict[str, Any], message: str) -> None:
    assert ratio(found, message, "zenoh") <= ZENOH_SHARE


@pytest.mark.benchmark
@pytest.mark.parametrize("message", AT_110_KB)
def test_a_round_trip_costs_half_of_doras_at_most(found: dict[str, Any], message: str) -> None:
    assert ratio(found, message, "dora") <= DORA_SHARE
