"""The first steps of every process of a robot."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from navloom_live.hosting import process_setup

STUCK = """
import ctypes, threading
from navloom_live.hosting import process_setup

process_setup.SHUTDOWN_LIMIT = 0.5
ending = threading.Event()
process_setup.end_on_signal(ending)
print("ready", flush=True)
ending.wait()
print("ending", flush=True)
ctypes.PyDLL(None).pause()  # keeps the interpreter for itself, as a library that is stuck may
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_process_ends_on_sigterm_even_while_code_holds_the_gil() -> None:
    with subprocess.Popen([sys.executable, "-c", STUCK], stdout=subprocess.PIPE, text=True) as stuck:
        assert stuck.stdout is not None and stuck.stdout.readline() == "ready\n"
        stuck.send_signal(signal.SIGTERM)
        assert stuck.stdout.readline() == "ending\n"
        try:
            assert stuck.wait(20) == -signal.SIGALRM
        finally:
            stuck.kill()


SEIZED = """
import re, signal, threading, time
from navloom_live.hosting import process_setup

alive = process_setup.end_unless_called(0.5)
until = time.monotonic() + 1.0
while time.monotonic() < until:  # computes for longer than that, but says so
    alive()
print("ready", flush=True)
signal.sigtimedwait([signal.SIGUSR1], 2.0)  # waits for longer than that
print("seized", flush=True)
re.match(r"(a+)+$", "a" * 64 + "b")  # years in one call of C code
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_process_whose_code_holds_the_gil_is_ended_and_one_that_waits_is_not() -> None:
    with subprocess.Popen([sys.executable, "-c", SEIZED], stdout=subprocess.PIPE, text=True) as seized:
        assert seized.stdout is not None and seized.stdout.readline() == "ready\n"
        assert seized.stdout.readline() == "seized\n"
        try:
            assert seized.wait(20) == -process_setup.SEIZED
        finally:
            seized.kill()
