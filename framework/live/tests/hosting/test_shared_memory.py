"""Shared memory that no process has open is removed, and no other."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

import pytest
from navloom_live.hosting import shared_memory


def test_only_segments_that_no_process_has_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_memory, "SEGMENTS", tmp_path)
    for name, size in (("1.zenoh", 8), ("2.zenoh", 8), ("3.zenoh", 0), ("4.other", 8)):
        (tmp_path / name).write_bytes(b"x" * size)
    held = os.open(tmp_path / "2.zenoh", os.O_RDWR)
    fcntl.flock(held, fcntl.LOCK_SH)  # as a process that opens a segment
    assert shared_memory.remove_orphans() == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["2.zenoh", "3.zenoh", "4.other"]
    os.close(held)
    assert shared_memory.remove_orphans() == 1
