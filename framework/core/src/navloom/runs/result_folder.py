"""Output folders of commands: files are written atomically, and earlier results are never overwritten."""

from __future__ import annotations

import fcntl
import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from navloom.config import ConfigError
from navloom.files import make_writable, write_each
from navloom.messages import OccupancyGrid
from navloom.runs.episode import Episode
from navloom.runs.shadow_comparison import shadow_table

__all__ = ["MAP", "Draft", "OutFolder", "ResultFolder", "TraceFile", "failure_of"]

MAP = ("map.yaml", "map.pgm")
TRACE = "trace.bin"
RUN = (TRACE, "result.json", "run.png", "shadows.csv", *MAP)


class OutFolder:
    """The folder of `--out`. Use it in a `with` statement; without a folder nothing is written.

    Args:
        folder: A new folder, or an existing one without any of the files.
        files: Patterns of the file names that the command may write.

    Raises:
        ConfigError: On entering: the folder contains such a file already, or cannot be written.

    Attributes:
        names: Names of the files that were written.
        missing: Why other files were not written, by name.
    """

    def __init__(self, folder: Path | None, files: Sequence[str]) -> None:
        self.folder, self.files = folder, files
        self.names: list[str] = []
        self.missing: dict[str, str] = {}
        self._is_new = False

    def __enter__(self) -> Self:
        if self.folder is not None:
            self._is_new = not self.folder.exists()
            try:
                self._claim(self.folder)
            except OSError as error:
                self._leave(self.folder)
                raise ConfigError(f"--out {self.folder}: cannot be written: {error.strerror}; name a folder") from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.folder is not None:
            self._leave(self.folder)

    def write(self, files: Mapping[str, str | bytes]) -> None:
        """Write files. Those that do not fit on the disk are recorded as missing; the others are complete."""
        if self.folder is not None:
            missing = write_each(self.folder, files)
            self.names += [name for name in files if name not in missing]
            self.missing |= missing

    def write_map(self, grid: OccupancyGrid) -> None:
        """Write a map as map_server files: the image, then, if that succeeded, the YAML file that names it."""
        from navloom.geometry.grid import GridMap
        from navloom.geometry.world import Place
        from navloom.runs.map_files import rosmap_files

        description, image = MAP
        origin = Place(grid.origin.x, grid.origin.y, grid.origin.heading)
        files = rosmap_files(GridMap(grid.cells, grid.resolution, origin), Path(image).stem)
        self.write({image: files[image]})
        if image in self.missing:
            self.missing[description] = f"without {image}"
        else:
            self.write({description: files[description]})

    @property
    def failure(self) -> str:
        """Message about missing and complete files; empty if nothing is missing."""
        return failure_of(f"--out {self.folder}", self.names, self.missing)

    def _claim(self, folder: Path) -> None:
        if folder.exists() and not folder.is_dir():
            raise ConfigError(f"--out {folder}: is a file; name a folder")
        earlier = next((path.name for name in self.files for path in sorted(folder.glob(name))), None)
        if earlier is not None:
            raise ConfigError(
                f"--out {folder}: holds {earlier} of an earlier result; name another folder, or remove it"
            )
        make_writable(folder)

    def _leave(self, folder: Path) -> None:
        if self._is_new and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def failure_of(place: str, names: Sequence[str], missing: Mapping[str, str]) -> str:
    """Message about a folder's files: missing ones with reasons, and complete ones; empty if none is missing."""
    if not missing:
        return ""
    told = ", ".join(f"{name} ({why})" for name, why in missing.items())
    return f"{place}: not written: {told}; complete there: {', '.join(names) or 'nothing'}"


class ResultFolder(OutFolder):
    """The folder of a run: result.json, trace.bin, run.png, the map and, with shadows, shadows.csv.

    Attributes:
        trace: File for the trace during the run; None without a folder.
    """

    def __init__(self, folder: Path | None) -> None:
        super().__init__(folder, RUN)
        self.trace: TraceFile | None = None

    def keep(self, episode: Episode, summary: dict[str, object]) -> None:
        """Write all files of a finished run."""
        if self.folder is None or self.trace is None:
            return
        if self.trace.finish(self.folder / TRACE):
            self.names.append(TRACE)
        else:
            self.missing[TRACE] = self.trace.failure
        files: dict[str, str | bytes] = {
            "result.json": json.dumps(summary, indent=2) + "\n",
        }
        if episode.shadows:
            files["shadows.csv"] = shadow_table(episode.shadows)
        self.write(files)
        if (saved := episode.recorder.saved_map) is not None:
            self.write_map(saved)

    def _claim(self, folder: Path) -> None:
        super()._claim(folder)
        self.trace = TraceFile(folder / f".{TRACE}.part")

    def _leave(self, folder: Path) -> None:
        if self.trace is not None:
            self.trace.discard()
        super()._leave(folder)


class Draft(io.FileIO):
    """A trace that is being written. A full disk ends the file, not the run.

    Args:
        path: Its path; an existing file is appended to.

    Attributes:
        failure: Why writing stopped; empty while it continues.
    """

    def __init__(self, path: Path | str) -> None:
        super().__init__(path, "ab")
        self.failure = ""

    def write(self, data: bytes | memoryview, /) -> int:  # type: ignore[override]
        """Write all of the data, or nothing once the disk is full."""
        rest = memoryview(data)
        try:
            while rest and not self.failure:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.failure = error.strerror or str(error)
            self.truncate(0)  # room for the result
        return len(data)


class TraceFile(Draft):
    """The draft of a trace, which only one run writes.

    Args:
        draft: Temporary path. A draft left by a killed run is overwritten.

    Raises:
        ConfigError: Another run is writing it.
    """

    def __init__(self, draft: Path) -> None:
        super().__init__(draft)
        self.draft = draft
        try:
            fcntl.flock(self, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise ConfigError(f"--out {draft.parent}: another run writes there now; name another folder") from None
        self.truncate(0)

    def finish(self, path: Path) -> bool:
        """Rename the draft to `path` if it is complete. Returns whether it was."""
        try:
            if not self.failure:
                os.fsync(self.fileno())
                self.draft.replace(path)
        except OSError as error:
            self.failure = error.strerror or str(error)
        return not self.failure

    def discard(self) -> None:
        """Remove the draft if it still exists."""
        if not self.closed:
            self.draft.unlink(missing_ok=True)
            self.close()
