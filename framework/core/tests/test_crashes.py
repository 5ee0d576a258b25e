"""The line of a plugin at which a process crashed, read from the dump that Python prints at a signal."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from navloom.crashes import crashed_at

PLUGIN = """
import ctypes, re, signal, os, sys
def avoid(how):
    if how == "segv":
        ctypes.string_at(0)
    if how == "abort":
        os.abort()
    if how == "gil":
        signal.setitimer(signal.ITIMER_PROF, 0.2)
        re.match(r"(a+)+$", "a" * 40 + "b")
"""
CALLER = """
import sys, threading, time, signal
from navloom.crashes import dump_on, dump_when_broken
dump_when_broken()
signal.signal(signal.SIGPROF, signal.SIG_DFL)
dump_on(signal.SIGPROF)
sys.path.insert(0, {folder!r})
import navloom.engine.stepper as stepper
import torn_plugin
print("think: ready", file=sys.stderr, flush=True)
node = type("Node", (), {{"made": [], "plugin": None}})()
one = stepper.Stepper.__new__(stepper.Stepper)
one.node = node
run = lambda: one.run({how!r}, torn_plugin.avoid)
threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
thread = threading.Thread(target=run, daemon=True)
thread.start()
thread.join()
"""


WATCHED = CALLER.replace(
    "dump_when_broken()\nsignal", "from navloom.crash_watch import watch_over\nwatch_over({whole})\nsignal"
)


def ended(folder: Path, how: str) -> tuple[int, Path]:
    """Exit code and log of a process that a plugin ends."""
    (folder / "torn_plugin.py").write_text(PLUGIN, "utf-8")
    log = folder / "think.log"
    with log.open("wb") as file:
        words = [sys.executable, "-c", CALLER.format(folder=str(folder), how=how)]
        code = subprocess.run(words, stderr=file, timeout=60).returncode
    return code, log


@pytest.mark.parametrize(
    ("how", "number", "place"),
    [
        ("segv", signal.SIGSEGV, "torn_plugin.py:5, in avoid"),
        ("abort", signal.SIGABRT, "torn_plugin.py:7, in avoid"),
        ("gil", signal.SIGPROF, "torn_plugin.py:10, in avoid"),
    ],
)
def test_the_plugins_line_is_found_in_the_log(tmp_path: Path, how: str, number: int, place: str) -> None:
    code, log = ended(tmp_path, how)
    assert (code, crashed_at(log.read_text("utf-8"))) == (-number, place)


def test_for_a_package_the_innermost_line_is_named(tmp_path: Path) -> None:
    (tmp_path / "__init__.py").touch()
    here = os.path.dirname(os.path.dirname(os.path.abspath(crashed_at.__code__.co_filename)))
    dump = textwrap.dedent(f"""\
        drive: ready
        Fatal Python error: Segmentation fault

        Thread 0x00007f0000000001 (most recent call first):
          File "{os.path.dirname(os.__file__)}/threading.py", line 331 in wait
          File "{here}/navloom/live/mailbox.py", line 99 in wait

        Current thread 0x00007f0000000002 (most recent call first):
          File "/somewhere/site-packages/numba/core/dispatcher.py", line 10 in compile
          File "{tmp_path}/kernels.py", line 7 in histogram
          File "{tmp_path}/plugin.py", line 31 in avoid
          File "{here}/navloom/engine/nodes/avoider_node.py", line 283 in step

        Extension modules: numpy, zenoh (total: 2)
        """)
    assert crashed_at(dump) == "kernels.py:7, in histogram"
    assert crashed_at(dump.replace(str(tmp_path), f"{here}/navloom/navigation")) == ""
    assert crashed_at("") == crashed_at("drive: ready\n") == ""


@pytest.mark.skipif(sys.platform != "linux", reason="needs memory that two processes share by its number")
@pytest.mark.parametrize("is_whole", [False, True])
def test_a_command_reports_the_crash_in_one_message(tmp_path: Path, is_whole: bool) -> None:
    (tmp_path / "torn_plugin.py").write_text(PLUGIN, "utf-8")
    script = WATCHED.format(folder=str(tmp_path), how="segv", whole=is_whole)
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    ready, told, *more = process.stderr.splitlines()
    assert process.returncode == -signal.SIGSEGV and ready == "think: ready"
    said = "navloom: the process crashed in C code: Segmentation fault at torn_plugin.py:5, in avoid"
    assert told == (said if is_whole else f"{said}; --traceback prints all lines")
    assert more[:1] == (["Fatal Python error: Segmentation fault"] if is_whole else [])


@pytest.mark.skipif(sys.platform != "linux", reason="needs memory that two processes share by its number")
def test_a_command_that_ends_normally_leaves_no_process_behind() -> None:
    script = "from navloom.crash_watch import watch_over\nwatch_over(False)\nprint('done')\nraise SystemExit(3)"
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    # Its output ends with it: another process that holds standard error would keep `run` waiting.
    assert (process.returncode, process.stdout, process.stderr) == (3, "done\n", "")


def test_for_code_that_holds_the_gil_the_message_says_how_to_end_it() -> None:
    from navloom.crash_watch import _message

    here = os.path.dirname(os.path.dirname(os.path.abspath(crashed_at.__code__.co_filename)))
    dump = "Timeout (0:00:15)!\nThread 0x00007f0000000001 (most recent call first):\n"
    dump += '  File "/lib/mine.py", line 18 in avoid\n'
    dump += f'  File "{here}/navloom/engine/nodes/avoider_node.py", line 283 in step\n'
    said = "navloom: no tick for 15 s: the run is at mine.py:18, in avoid, which holds the GIL; `kill 7` ends it\n"
    assert _message(dump, 7, is_whole=False) == said
