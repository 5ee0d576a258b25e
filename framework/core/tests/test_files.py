"""Atomic writes: a file is complete or absent."""

from __future__ import annotations

from pathlib import Path

import pytest
from navloom.files import write_whole


def test_a_file_is_replaced_by_the_new_contents(tmp_path: Path) -> None:
    path = tmp_path / "told.txt"
    write_whole(path, b"\x00old")
    assert path.read_bytes() == b"\x00old"
    write_whole(path, "neu: ü\r\n")
    assert path.read_bytes() == "neu: ü\r\n".encode()
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_leaves_no_temporary_file(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError):
        write_whole(tmp_path / "folder", "text")
    (tmp_path / "told.txt").write_text("old")
    with pytest.raises(UnicodeEncodeError):
        write_whole(tmp_path / "told.txt", "a lone surrogate: \ud800")
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "told.txt"}
    assert (tmp_path / "told.txt").read_text() == "old"
