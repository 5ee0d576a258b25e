"""The observers of a run that `--record` and the viewer's options ask for, and who sees that it stands still."""

from __future__ import annotations

import faulthandler
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from navloom.cli.output import LOG, log_of
from navloom.crash_watch import dump_file, is_watched
from navloom.parts import part

if TYPE_CHECKING:
    from navloom.config import Loaded

__all__ = ["recorded", "watched", "watched_for_stalls"]

STALLED = 10.0
"""Longest time without a tick before the line that blocks the run is logged, s."""
COMPILING = 12
"""Factor by which the first tick may take longer, because kernels compile."""
COMPILER = {"numba", "llvmlite"}
BENEATH = sys.stdlib_module_names | COMPILER
"""Modules whose lines are of no use to a user."""


class _Unwatched:
    """The place of the viewer's `Watch` in a run that is not shown."""

    observers: Sequence[Any] = ()
    showing = None

    def between(self, progress: Callable[[float, float], None]) -> Callable[[float, float], None]:
        """The progress function as it is."""
        return progress

    def finish(self) -> None:
        """Nothing is left to draw."""


def watched(where: Any, watch: str, shown: Loaded | Sequence[Loaded]) -> AbstractContextManager[Any]:
    """The viewer's watch over a run, or one that shows nothing.

    Args:
        where: Where to show it; None for nowhere.
        watch: Name of the watch: "watch_run", or "watch_fleet" of several configs.
        shown: What it shows.

    Raises:
        ViewerError: It cannot be shown there.
    """
    if where is None:
        return nullcontext(_Unwatched())
    make: Callable[..., AbstractContextManager[Any]] = getattr(part("navloom_viewer.lockstep_viewing"), watch)
    return make(shown, where, log_of("viewer").info)


def recorded(loaded: Loaded, path: Path | None) -> AbstractContextManager[Any]:
    """The observer that writes a recording, or None."""
    if path is None:
        return nullcontext()
    recording: AbstractContextManager[Any] = part("navloom_recording.lockstep_recorder", "--record").recorded(
        loaded, path, log_of("recording").warning
    )
    return recording


@contextmanager
def watched_for_stalls(
    progress: Callable[[float, float], None], patience: float = STALLED
) -> Iterator[Callable[[float, float], None]]:
    """A progress function. If it is not called for `patience`, s, the line of code that blocks the run is logged.

    Before the first tick kernels may compile, so the limit is `COMPILING` times as long until then.
    """
    runs, moved, ended = threading.get_ident(), [time.monotonic()], threading.Event()
    limits = [COMPILING * patience]

    def tell(done: float, total: float) -> None:
        moved[0], limits[0] = time.monotonic(), patience
        if is_watched():  # while code holds the GIL, the thread below cannot run
            faulthandler.dump_traceback_later(1.5 * patience, file=dump_file())
        progress(done, total)

    def look() -> None:
        told = 0.0
        while not ended.wait(0.1 * patience):
            last, limit = moved[0], limits[0]
            if last != told and time.monotonic() - last > limit:
                told = last
                faulthandler.cancel_dump_traceback_later()
                LOG.warning(f"no tick for {limit:g} s: {_where(sys._current_frames()[runs])}; Ctrl-C ends it")

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield tell
    finally:
        faulthandler.cancel_dump_traceback_later()
        ended.set()
        thread.join()


def _where(frame: FrameType) -> str:
    """The line that a thread is at, in words, outside Python's own modules and the kernel compiler."""
    compiles = False
    while frame.f_back and (top := frame.f_globals["__name__"].partition(".")[0]) in BENEATH:
        compiles |= top in COMPILER
        frame = frame.f_back
    place = f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}, in {frame.f_code.co_name}"
    return f"a kernel is being compiled for {place}" if compiles else f"the run is at {place}"
