"""The trace is encoded in batches: the bytes are the same, and a run cut short loses at most the last batch."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path

import numpy as np
import pytest
from navloom.engine import trace as traces
from navloom.engine.trace import TraceWriter, read_trace
from navloom.messages import Command, Twist2D


def say(writer: TraceWriter, tick: int, name: str, vx: float) -> None:
    key = f"lab/r1/avoider/{name}/command"
    label = f"avoider {name} command navloom.Command/1".encode()
    writer.entries.append((label, Command(Twist2D(vx, 0.0, 0.0)), (tick, tick, tick, 0), key))


def written(batch: int, monkeypatch: pytest.MonkeyPatch) -> tuple[bytes, str]:
    monkeypatch.setattr(traces, "BATCH", batch)
    file = io.BytesIO()
    writer = TraceWriter(file)
    for tick in range(10):
        for name in ("b", "a"):
            say(writer, tick, name, 0.1 * tick)
        writer.end_tick(tick)
    return file.getvalue(), writer.sha256()


def test_the_size_of_a_batch_changes_no_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    one, hash_of_one = written(1, monkeypatch)
    _, hash_of_many = written(4, monkeypatch)
    assert hash_of_one == hash_of_many == hashlib.sha256(one).hexdigest()


def test_a_trace_cut_short_can_be_read_up_to_the_last_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(traces, "BATCH", 4)
    path = tmp_path / "trace.bin"
    with path.open("wb") as file:
        writer = TraceWriter(file)
        for tick in range(6):
            say(writer, tick, "a", 0.0)
            writer.end_tick(tick)
        # As if the process had ended before it could write the rest.
        assert [entry.tick for entry in read_trace(path)] == [0, 1, 2, 3]


def test_numbers_of_numpy_and_minus_zero_are_held_as_plain_numbers() -> None:
    twist = Twist2D(np.float64(0.5), 0, np.float32(0.25))  # type: ignore[arg-type]
    assert [type(value) for value in (twist.vx, twist.vy, twist.wz)] == [float, float, float]
