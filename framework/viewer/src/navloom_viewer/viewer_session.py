"""Shows a run: starts a viewer and the drawing process, and reports the result."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from navloom_viewer.bridge import Bridge, BridgeCounts
from navloom_viewer.drawing_task import ViewerOrder
from navloom_viewer.picture_setup import Facts
from navloom_viewer.program import Program, address_of, is_up
from navloom_viewer.viewer_errors import ViewerError, need_rerun

__all__ = ["Showing", "Where", "showing"]

PATIENCE = 10.0
"""Longest wait of a run for a viewer that accepts nothing, s; live runs do not wait."""


@dataclass(frozen=True)
class Where:
    """Where to show a run.

    Attributes:
        file: .rrd file, or None.
        url: URL of a running viewer, or None.
        opens: Whether to start a viewer.
        web: Whether to serve it to a browser instead of opening a window.
        options: Options of the viewer's program, for tests.
    """

    file: Path | None = None
    url: str | None = None
    opens: bool = False
    web: bool = False
    options: tuple[str, ...] = ()


@dataclass(eq=False)
class Showing:
    """A run while it is shown.

    Attributes:
        bridge: Bridge to put messages into.
        program: The viewer that was started, or None.
        file: The file that is written, or None.
        say: Receives the report of messages drawn and dropped.
        counts: Counts of messages, once it is finished.
        is_finished: Whether `finish` was called.
    """

    bridge: Bridge
    program: Program | None = None
    file: Path | None = None
    say: Callable[[str], None] = lambda text: None
    counts: BridgeCounts = field(default_factory=BridgeCounts)
    is_finished: bool = False

    def finish(self) -> None:
        """Draw all messages that were put in, report the counts, and accept no more. A second call does nothing."""
        if self.is_finished:
            return
        self.is_finished = True
        self.counts = self.bridge.close()
        if self.file is not None and not self.bridge.put_in:
            self.file.unlink(missing_ok=True)  # the run was refused: there is nothing to see
        _tell(self.counts, self.file, self.say)

    @property
    def is_closed(self) -> bool:
        """Whether the user has closed the viewer that was started."""
        return self.program is not None and self.program.process.poll() is not None


@contextmanager
def showing(
    facts: Facts,
    where: Where,
    *,
    recording_id: str,
    live: bool = False,
    blocked: frozenset[str] = frozenset(),
    say: Callable[[str], None] = lambda text: None,
) -> Iterator[Showing]:
    """Show messages that are put into `bridge`, for the duration of a `with` statement.

    A window stays open afterwards. A web server stays until Ctrl-C, except for a live robot.

    Args:
        facts: The robots in the picture.
        where: File, viewer or both.
        recording_id: Identifier, equal for the same run; in a viewer each showing is a recording of its own.
        live: Whether the run is live and must not wait.
        blocked: Plugins that count as not installed.
        say: Receives one-line messages for the user.

    Raises:
        ViewerError: There is no viewer, or no file can be written.
        ViewerLost: The viewer that was started ended with an error.
    """
    need_rerun()
    program = None
    url = where.url
    if url is not None:
        host, port = address_of(url)
        url = f"rerun+http://{host}:{port}/proxy"
        if not is_up(host, port, 2.0):
            raise ViewerError(f"--viewer {url}: nothing listens there; start one with `rerun --bind 127.0.0.1`")
    elif where.opens:
        program = Program(where.web, options=where.options)
        url = program.url
        if program.page is not None:
            say(f"the viewer is at {program.page}; it ends with this command")
    if url is not None:
        # The viewer may already show this run; a new identifier makes this showing a separate recording.
        recording_id = f"{recording_id}-{time.time_ns()}"
    order = ViewerOrder(facts, where.file, url, recording_id, blocked, 0.0 if live else PATIENCE)
    try:
        bridge = Bridge(order)
        bridge.await_start()
    except BaseException:
        if program is not None:
            program.end()
        raise
    found = Showing(bridge, program, where.file, say)
    if program is not None:
        try:
            program.await_window()
        except BaseException:
            found.finish()
            program.end()
            raise
    is_over = False
    try:
        yield found
        is_over = True
    finally:
        found.finish()
        if program is not None:
            program.leave(say, serves=is_over and not live)


def _tell(counts: BridgeCounts, file: Path | None, say: Callable[[str], None]) -> None:
    for note in counts.notes:
        say(note)
    if file is not None and counts.file_failure and counts.file_failure not in counts.notes:
        size = file.stat().st_size if file.exists() else 0
        say(f"--rerun {file}: {counts.file_failure}; it is cut short, and its first {size} bytes can be viewed")
    if counts.dropped:
        say(f"{counts.dropped} messages were dropped: drawing was slower than they came")
    if counts.dropped_live:
        kept = f"; {file} has them" if file is not None else ""
        say(f"{counts.dropped_live} shapes did not reach the viewer: it was too slow or did not answer{kept}")
