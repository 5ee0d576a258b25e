import signal
import subprocess
import sys

import pytest

CHILD = """
import os, signal, sys
from navloom.parent_process import die_with_parent
die_with_parent(int(sys.argv[1]), signal.SIGKILL)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print(os.getpid(), flush=True)
while True:
    signal.pause()
"""
PARENT = """
import os, signal, subprocess, sys
subprocess.Popen([sys.executable, "-c", sys.argv[1], str(os.getpid())])
signal.pause()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a process that its parent died")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_child_that_ignores_signals_ends_with_its_parent(number: int) -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT, CHILD], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    assert int(parent.stdout.readline()) != parent.pid
    parent.send_signal(number)
    # Both have the pipe open, so it ends when the child does.
    assert parent.stdout.read() == ""
    parent.wait()
    parent.stdout.close()


def test_a_child_whose_parent_is_gone_ends_at_once() -> None:
    done = subprocess.run([sys.executable, "-c", CHILD, "1"], stdout=subprocess.PIPE, check=False)
    assert (done.returncode, done.stdout) == (1, b"")
