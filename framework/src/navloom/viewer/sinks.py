"""Where drawn things go: a file that is whole, or a viewer that may be slow, frozen, gone or back again."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.viewer.blueprint import TIMELINE

__all__ = ["FileSink", "send", "send_series", "stream"]

APPLICATION = "navloom"


def stream(title: str, recording_id: str) -> Any:
    """A recording stream of nothing but our own timelines, so that two of the same run are alike."""
    import rerun as rr

    made = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
    made.set_log_time_enabled(False)
    made.set_log_tick_enabled(False)
    return made


def send(recording: Any, path: str, archetypes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
    """Log shapes with every timeline stamped: times stick to a thread, and would else be those of another entity."""
    if tick is None:
        recording.log(path, *archetypes, static=True)
        return
    recording.set_time("tick", sequence=tick)
    recording.set_time(TIMELINE, duration=np.timedelta64(stamp_ns, "ns"))
    recording.log(path, *archetypes)


def send_series(
    recording: Any, path: str, ticks: NDArray[np.int64], stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
) -> None:
    """Log numbers, (n,) each, in one call."""
    import rerun as rr

    times = [
        rr.TimeColumn("tick", sequence=ticks),
        rr.TimeColumn(TIMELINE, duration=stamps_ns.astype("timedelta64[ns]")),
    ]
    recording.send_columns(path, times, rr.Scalars.columns(scalars=values))


class FileSink:
    """An .rrd file. Whole once it is closed; cut short before, it still opens.

    Args:
        path: Of the file; an existing one is refused.
        title: Shown as the recording's name.
        recording_id: The same for the same run.

    Attributes:
        failure: Why the file is cut short, known once it is closed; empty where it is whole.
    """

    def __init__(self, path: Path, title: str, recording_id: str) -> None:
        from navloom.viewer.extra import ViewerError

        self.path, self.failure = path, ""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("xb"):
                pass
        except FileExistsError:
            kind = "folder" if path.is_dir() else "file"
            raise ViewerError(f"--rerun {path}: there is such a {kind} already; name another, or remove it") from None
        except OSError as error:
            raise ViewerError(f"--rerun {path}: {error.strerror}") from None
        self._stream = stream(title, recording_id)
        self._stream.save(path)
        self._stream.send_recording_name(title)

    def layout(self, blueprint: Any) -> None:
        """What is shown where."""
        self._stream.send_blueprint(blueprint)

    def log(self, path: str, archetypes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
        """Shapes of an entity."""
        send(self._stream, path, archetypes, tick, stamp_ns)

    def series(
        self, path: str, ticks: NDArray[np.int64], stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Numbers of a time series."""
        send_series(self._stream, path, ticks, stamps_ns, values)

    def close(self) -> None:
        """Everything on disk, or, where it is full, what fitted."""
        try:
            self._stream.flush()
        except RuntimeError as error:  # the SDK keeps the system's own word to itself
            is_full = os.statvfs(self.path).f_bavail == 0
            self.failure = os.strerror(errno.ENOSPC) if is_full else str(error)
        self._stream.disconnect()
