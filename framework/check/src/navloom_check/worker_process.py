"""The process that a plugin runs in: its reports, and the finding if it ends early."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path, PurePath
from queue import Empty, Queue
from threading import Thread
from typing import Any

from navloom_check.checked_plugin import CheckRequest
from navloom_check.findings import Finding
from navloom_check.side_effects import TIMEOUT

__all__ = ["FLAGS", "MARK_SIZE", "Process", "digests_of"]

FLAGS = ("-X", "warn_default_encoding", "-W", "ignore::EncodingWarning")
"""Flags of the interpreter: it can warn of text files that are opened without an encoding, as `scheme_files` asks."""
MARK_SIZE = 256
"""Size of the file that names the current call, bytes."""
SILENCE = 240.0
"""Longest time without a report, s, after which the process is killed. Calls have a shorter limit."""
FRAME = re.compile(r'File "([^"]+)", line (\d+)')


class Process:
    """A worker process, as a context manager.

    Args:
        job: The job of `navloom_check.worker`.
        hash_seed: PYTHONHASHSEED of the process.
    """

    def __init__(self, job: dict[str, Any], hash_seed: int = 0) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="navloom-check-")
        self.mark, self.crash = Path(self._folder.name) / "mark", Path(self._folder.name) / "crash"
        self.mark.write_bytes(bytes(MARK_SIZE))
        self.crash.touch()
        self._errors = open(Path(self._folder.name) / "stderr", "w+")  # noqa: SIM115
        self.is_silent = False
        self._child = subprocess.Popen(
            [sys.executable, *FLAGS, "-m", "navloom_check.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            start_new_session=True,
            env={**os.environ, "PYTHONHASHSEED": str(hash_seed)},
        )
        assert self._child.stdin is not None
        order = {**job, "parent": os.getpid(), "mark": str(self.mark), "crash": str(self.crash)}
        self._child.stdin.write(json.dumps(order))
        self._child.stdin.close()

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *given: object) -> None:
        # The session, since a plugin may have started processes of its own.
        with suppress(ProcessLookupError):
            os.killpg(self._child.pid, signal.SIGKILL)
        self._child.wait()
        self._errors.close()
        self._folder.cleanup()

    def lines(self) -> Iterator[dict[str, Any]]:
        """Its reports, until it ends or is killed for its silence."""
        queue: Queue[str | None] = Queue()
        Thread(target=self._read, args=(queue,), daemon=True).start()
        while True:
            try:
                line = queue.get(timeout=SILENCE)
            except Empty:
                self.is_silent = True
                self._child.kill()
                return
            if line is None:
                self._child.wait()
                return
            yield json.loads(line)

    def _read(self, queue: Queue[str | None]) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            queue.put(line)
        queue.put(None)

    def autopsy(self, folder: str, usual_place: str) -> tuple[str, Finding]:
        """Name of the check that reports how the process ended, and its finding.

        Args:
            folder: Folder of the plugin's code.
            usual_place: File and line to blame if the crash names none.
        """
        crash = self.crash.read_text(errors="replace")
        call = self.mark.read_bytes().rstrip(b"\0 ").decode(errors="replace")
        place = _place_in(crash, folder) or usual_place
        what = f"{call}()" if call else "its code"
        code = self._child.returncode
        if code == -TIMEOUT or self.is_silent:
            return "returns", Finding(f"{what} does not return", "a call that ends within its time", place)
        if crash.startswith("Fatal Python error"):
            fatal = crash.splitlines()[0].removeprefix("Fatal Python error: ")
            return "survives", Finding(f"{what} crashes the process: {fatal}", "code that never does", place)
        how = f"is killed by signal {-code}" if code < 0 else f"ends with exit code {code}"
        self._errors.seek(0)
        last = (self._errors.read().strip().splitlines() or [""])[-1]
        hint = f" ({last[:200]})" if last else ""
        return "survives", Finding(f"the process {how} in {what}{hint}", "an answer or an exception; no exit", place)


def _place_in(crash: str, folder: str) -> str:
    """The innermost line of the plugin in the output of faulthandler."""
    for file, line in FRAME.findall(crash):
        if folder and (file == folder or file.startswith(folder + os.sep)):
            return f"{PurePath(file).name}:{line}"
    return ""


def digests_of(
    request: CheckRequest, hash_seed: int, steps: Mapping[str, int], alike: bool = False
) -> dict[str, list[bytes]]:
    """Hashes of a plugin's answers by scene, from a fresh process with another hash seed.

    Args:
        request: The plugin.
        hash_seed: PYTHONHASHSEED of the process.
        steps: Number of steps of each scene.
        alike: Use the clock and global random seeds of every play; else others.
    """
    job = {
        "name": request.name,
        "params": list(request.params),
        "seed": request.seed,
        "out": "",
        "alike": alike,
        "steps": dict(steps),
    }
    found: dict[str, list[bytes]] = {}
    with Process({**job, "checks": []}, hash_seed) as process:
        for line in process.lines():
            for scene, answers in line.get("digests", {}).items():
                found[scene] = [bytes.fromhex(answer) for answer in answers]
    return found
