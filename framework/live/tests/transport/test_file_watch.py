"""Files that are replaced while a process runs."""

from __future__ import annotations

from pathlib import Path

from navloom_live.transport.file_watch import FileWatch


def test_a_replaced_file_is_reported_once_and_not_while_it_changes(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    one.write_text("1", "utf-8")
    watch = FileWatch([one, other])
    assert not watch.has_changed()
    one.write_text("12", "utf-8")
    assert not watch.has_changed()
    other.write_text("3", "utf-8")
    assert not watch.has_changed()  # just changed again: a copy may be in progress
    assert watch.has_changed()
    assert not watch.has_changed()


def test_a_change_that_is_known_already_is_not_reported(tmp_path: Path) -> None:
    one = tmp_path / "one"
    watch = FileWatch([one])
    one.write_text("1", "utf-8")
    watch.take()
    assert not watch.has_changed() and not watch.has_changed()
