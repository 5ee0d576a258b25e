"""What every process of a robot does first."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

STUCK = """
import ctypes, threading
from navloom.runtime import process

process.GRACE = 0.5
ending = threading.Event()
process.end_on_signal(ending)
print("ready", flush=True)
ending.wait()
print("ending", flush=True)
ctypes.PyDLL(None).pause()  # keeps the interpreter for itself, as a library that is stuck may
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_process_that_was_told_to_end_ends_even_where_python_stands_still() -> None:
    with subprocess.Popen([sys.executable, "-c", STUCK], stdout=subprocess.PIPE, text=True) as stuck:
        assert stuck.stdout is not None and stuck.stdout.readline() == "ready\n"
        stuck.send_signal(signal.SIGTERM)
        assert stuck.stdout.readline() == "ending\n"
        try:
            assert stuck.wait(20) == -signal.SIGALRM
        finally:
            stuck.kill()
