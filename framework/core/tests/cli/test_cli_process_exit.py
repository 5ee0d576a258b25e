"""How a command's process ends, and what `--traceback` adds to its one message."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import pytest
from navloom.entry_kinds import TRACEBACK

Run = Callable[..., tuple[int, str, str]]

STAYS = """
import sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from navloom.cli.process_exit import end_in_time
from navloom.logs import Level, set_up_logging

def work():
    {does}

if {in_pool}:
    ThreadPoolExecutor(1).submit(work)
else:
    threading.Thread(target=work, name="stays").start()
set_up_logging(Level.INFO, as_json=False)
end_in_time(3, 0.2)
sys.exit(3)
"""


@pytest.mark.parametrize(
    ("does", "in_pool", "told"),
    [
        ("time.sleep(60)", False, "navloom: the thread 'stays' kept the process alive: ended after 0.2 s\n"),
        ("time.sleep(60)", True, "navloom: the thread 'ThreadPoolExecutor-0_0' kept the process alive: ended after"),
        ("time.sleep(0.01)", False, ""),
        ("pass", True, ""),
    ],
    ids=["thread", "busy executor", "thread that ends", "idle executor"],
)
def test_a_process_ends_though_threads_still_run(does: str, in_pool: bool, told: str) -> None:
    words = [sys.executable, "-c", STAYS.format(does=does, in_pool=in_pool)]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=30)
    assert ended.returncode == 3
    assert ended.stderr.startswith(told) if told else ended.stderr == ""


BROKEN = "from navloom import hookimpl\n\ndef half(x):\n    return 1 / x\n\nhalf(0)\n"


def test_traceback_is_printed_after_the_message(
    in_process: Run, install: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(TRACEBACK, "")
    install("navloom_torn", BROKEN, ["avoider.torn"])
    words = ("run", "paper", "--set", "avoider.plugin=torn")
    code, _, short = in_process(*words)
    assert code == 2 and "fails on import: ZeroDivisionError: division by zero (navloom_torn.py:4)" in short
    assert "Traceback" not in short
    code, _, long = in_process(*words, "--traceback")
    assert code == 2 and long.startswith(short)
    assert 'navloom_torn.py", line 6, in <module>\n    half(0)' in long and long.count("Traceback") == 1


@pytest.mark.parametrize("words", [("worlds",), ("config", "check", "paper"), ("config", "show", "--help")])
def test_every_command_takes_traceback(
    in_process: Run, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(TRACEBACK, "")
    assert in_process(*words, "--traceback")[0] == 0
