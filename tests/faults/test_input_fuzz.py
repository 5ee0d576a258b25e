"""Every decoder of files, given mutated and random files, gives a value or its typed error, within bounds."""

from __future__ import annotations

from pathlib import Path

import pytest
from input_fuzz import decoders, fuzz

MOST_SECONDS, MOST_MEMORY_MB = 10.0, 300.0


def test_every_decoder_reads_its_valid_files(tmp_path: Path) -> None:
    for decoder in decoders(tmp_path):
        (tmp_path / "f").write_bytes(decoder.pack(decoder.seeds[0]))
        decoder.read(tmp_path / "f")


@pytest.mark.parametrize(("count", "seconds"), [(30, 1.0), pytest.param(20_000, 60.0, marks=pytest.mark.slow)])
def test_damaged_files_give_typed_errors(tmp_path: Path, count: int, seconds: float) -> None:
    read = 0
    for decoder in decoders(tmp_path):
        found = fuzz(decoder, count, seconds, seed=count)
        read += found.read
        assert found.count > 3 and not found.defects, (decoder.name, found)
        assert found.slowest < MOST_SECONDS and found.memory_mb < MOST_MEMORY_MB, (decoder.name, found)
    assert read > 20  # most files are damaged beyond reading, but not all
