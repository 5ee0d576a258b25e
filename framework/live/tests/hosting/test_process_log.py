"""Logs are bounded, and keep the last lines."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from navloom.engine import stepper
from navloom_live.hosting.process_log import LARGEST_LOG, ProcessLog, last_crash, last_lines, older_log


def test_a_log_that_grows_too_large_is_rotated_and_keeps_its_last_part(tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    log = ProcessLog(path)
    with path.open("ab") as writer:
        writer.write(b"x" * (3 * LARGEST_LOG) + b"\nbefore\n")
        writer.flush()
        log.bound()
        assert older_log(path).stat().st_size == LARGEST_LOG and log.cut == 2 * LARGEST_LOG + len(b"\nbefore\n")
        writer.write(b"the last word\n")
        writer.flush()
        log.bound()
    assert path.stat().st_size < 200
    assert last_lines(path, 2) == ["before", "the last word"]
    log.close()


def test_a_log_that_is_cut_within_a_line_shows_no_notice_among_its_last_lines(tmp_path: Path) -> None:
    log = ProcessLog(tmp_path / "drive.log")
    os.write(log.file, b"x" * (LARGEST_LOG + 1))
    log.bound()
    os.write(log.file, b"the last word\n")
    assert [line.strip("x") for line in last_lines(log.path, 2)] == ["", "the last word"]
    log.close()


def test_without_its_folder_lines_are_lost_and_nothing_fails(tmp_path: Path) -> None:
    path = tmp_path / "rt" / "drive.log"
    log = ProcessLog(path)
    os.write(log.file, b"lost\n")
    log.bound()
    assert last_lines(path, 3) == []
    path.parent.mkdir()
    log.reopen()
    os.write(log.file, b"kept\n")
    assert last_lines(path, 3) == ["kept"]
    log.close()


def test_lines_from_before_the_folder_was_deleted_can_still_be_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    log = ProcessLog(path)
    os.write(log.file, b"before\n")
    path.unlink()
    log.link()
    os.write(log.file, b"after\n")
    assert last_lines(path, 3) == (["before", "after"] if sys.platform == "linux" else [])
    log.close()
    assert not path.is_symlink()


CRASHED = f"""think: ready
Fatal Python error: Segmentation fault

Current thread 0x00007f0000000002 (most recent call first):
  File "/plugins/torn_plugin.py", line 5 in avoid
  File "{stepper.__file__}", line 9 in run
"""


def test_a_crash_is_found_at_the_end_of_a_log_whose_last_lines_leave_out_the_threads(tmp_path: Path) -> None:
    log = tmp_path / "think.log"
    log.write_text(CRASHED, "utf-8")
    assert last_crash(log) == "torn_plugin.py:5, in avoid"
    assert last_lines(log, 3) == ["think: ready", "Fatal Python error: Segmentation fault"]


def test_the_dump_of_an_earlier_process_is_ignored(tmp_path: Path) -> None:
    log = tmp_path / "think.log"
    log.write_text(CRASHED + "think: ready\n", "utf-8")
    assert last_crash(log) == ""


PRINTS = """
import os, sys
from navloom_live.hosting.process_setup import tolerate_write_errors
tolerate_write_errors()
print("x" * 10**7, flush=True)
print("the last word", flush=True)
full = os.open("/dev/full", os.O_WRONLY)
os.dup2(full, 1)
print("lost", flush=True)
print("after", file=sys.stderr)
"""


def test_printing_much_or_on_a_full_disk_fails_no_node() -> None:
    done = subprocess.run([sys.executable, "-c", PRINTS], capture_output=True, timeout=60, check=False)
    assert done.returncode == 0 and done.stderr == b"after\n"
    assert len(done.stdout) <= LARGEST_LOG + len("\nthe last word\n") and done.stdout.endswith(b"x\nthe last word\n")


def test_a_log_may_be_a_device_that_takes_everything(tmp_path: Path) -> None:
    log = ProcessLog(tmp_path)  # a folder cannot be written to
    assert os.write(log.file, b"lost\n") == 5
    log.close()
