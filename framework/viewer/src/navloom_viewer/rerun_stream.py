"""The file sink, and functions that send drawings to a rerun stream."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom_viewer.blueprint import TIMELINE

__all__ = ["FileSink", "send", "send_series", "stream"]

APPLICATION = "navloom"


def stream(title: str, recording_id: str) -> Any:
    """A recording stream with only our own timelines, so that two streams of the same run are equal."""
    import rerun as rr

    made = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
    made.set_log_time_enabled(False)
    made.set_log_tick_enabled(False)
    return made


def send(recording: Any, path: str, archetypes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
    """Log shapes with all timelines set: the SDK keeps times per thread, so they could be those of another entity."""
    if tick is None:
        recording.log(path, *archetypes, static=True)
        return
    recording.set_time("tick", sequence=tick)
    recording.set_time(TIMELINE, duration=np.timedelta64(stamp_ns, "ns"))
    recording.log(path, *archetypes)


def send_series(
    recording: Any, path: str, ticks: NDArray[np.int64], stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
) -> None:
    """Log values of a time series, (n,) each, in one call."""
    import rerun as rr

    times = [
        rr.TimeColumn("tick", sequence=ticks),
        rr.TimeColumn(TIMELINE, duration=stamps_ns.astype("timedelta64[ns]")),
    ]
    recording.send_columns(path, times, rr.Scalars.columns(scalars=values))


class FileSink:
    """An .rrd file. It is complete after `close`; if it is cut short before, it can still be opened.

    Args:
        path: Path of the file; an existing one is refused.
        title: Name of the recording in the viewer.
        recording_id: Identifier, equal for the same run.

    Attributes:
        failure: Why the file is cut short, known after `close`; empty if it is complete.
    """

    def __init__(self, path: Path, title: str, recording_id: str) -> None:
        from navloom_viewer.viewer_errors import ViewerError

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
        """Write the layout."""
        self._stream.send_blueprint(blueprint)

    def log(self, path: str, archetypes: Sequence[Any], tick: int | None, stamp_ns: int) -> None:
        """Write shapes of an entity."""
        send(self._stream, path, archetypes, tick, stamp_ns)

    def series(
        self, path: str, ticks: NDArray[np.int64], stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Write values of a time series."""
        send_series(self._stream, path, ticks, stamps_ns, values)

    def close(self) -> None:
        """Write everything to disk; on a full disk set `failure`."""
        try:
            self._stream.flush()
        except RuntimeError as error:  # the SDK does not report the system's error number
            is_full = os.statvfs(self.path).f_bavail == 0
            self.failure = os.strerror(errno.ENOSPC) if is_full else str(error)
        self._stream.disconnect()
