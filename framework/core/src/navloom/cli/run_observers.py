"""The observers of a run that `--record` and the viewer's options ask for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navloom.cli.output import log_of
from navloom.parts import part

if TYPE_CHECKING:
    from navloom.config import Loaded

__all__ = ["recorded", "watched"]


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
