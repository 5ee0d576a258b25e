"""A child that a plugin forks holds no resource of the robot."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux lists the open files of a process")
PARENT = """
import fcntl, os, signal, socket, sys, time
from navloom_live.hosting.fork_inheritance import keep_from_children
from navloom_live.transport.links import Link
own, other = sys.argv[1:]
listening = socket.socket(socket.AF_UNIX); listening.bind(own); listening.listen()
calling = socket.socket(socket.AF_UNIX); calling.connect(other)
lock = os.open(own + ".lock", os.O_RDONLY | os.O_CREAT, 0o600)
os.set_inheritable(lock, True)
fcntl.flock(lock, fcntl.LOCK_EX)
mine, yours = socket.socketpair()
signal.signal(signal.SIGTERM, lambda *given: None)
forked = []
keep_from_children(Link("peer", (f"unixsock-stream/{own}",), (f"unixsock-stream/{other}",)), lambda: forked.append(1))
assert not os.get_inheritable(lock)
if os.fork() == 0:
    names = [os.readlink(f"/proc/self/fd/{end}") for end in (listening.fileno(), calling.fileno(), lock)]
    mine.send(b"mine works")
    is_default = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    print(os.getpid(), set(names) == {"/dev/null"}, yours.recv(32) == b"mine works", is_default, forked, flush=True)
    sys.stdin.readline()
else:
    os.wait()
"""


def test_a_fork_holds_no_socket_and_no_lock_of_the_robot_and_keeps_its_own(tmp_path: Path) -> None:
    import socket

    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(tmp_path / "other.sock"))
        other.listen()
        own = tmp_path / "own.sock"
        parent = subprocess.Popen(
            [sys.executable, "-c", PARENT, str(own), str(tmp_path / "other.sock")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert parent.stdout is not None and parent.stdin is not None
        child, *found = parent.stdout.readline().split()
        assert found == ["True", "True", "True", "[1]"]
        parent.kill()
        parent.wait()
        lock = os.open(f"{own}.lock", os.O_RDONLY)
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # a new process in the parent's place gets the lock
        os.close(lock)
        assert Path(f"/proc/{child}").exists()
        parent.communicate("\n")
