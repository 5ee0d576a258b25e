"""Mutated messages give typed errors only, and cost little time and memory."""

from __future__ import annotations

import gc

import fuzz_codec
import pytest


@pytest.mark.parametrize("count", [5_000, pytest.param(200_000, marks=pytest.mark.slow)])
def test_mutated_messages_give_typed_errors_and_cost_little(count: int) -> None:
    gc.freeze()  # collecting the objects of earlier tests is not a cost of decoding
    try:
        found = fuzz_codec.fuzz_codec(count, seed=count)
    finally:
        gc.unfreeze()
    assert found.wrong == []
    assert found.refused > count / 2 and found.decoded > count / 100
    assert found.worst_bytes < 4_000_000
    assert found.worst_s < 0.05, found.slowest
