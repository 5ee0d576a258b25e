"""Files that a run wrote, listed for people and scripts. Incomplete files set the exit code."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from navloom.cli.output import LOG
from navloom.parts import PARTS, has_part

if TYPE_CHECKING:
    from navloom.runs.result_folder import OutFolder

__all__ = ["File", "Written", "record_of", "rerun_of", "tell_out"]

PICTURE = "run.png"
"""Picture of a run, drawn by an observer of navloom-study."""


@dataclass(frozen=True)
class File:
    """A file that was written during a run. If it is incomplete, that was logged when it happened.

    Attributes:
        path: Its path.
        messages: Number of messages in it.
        size: Its size, bytes.
        is_whole: Whether it is complete.
    """

    path: Path
    messages: int
    size: int
    is_whole: bool

    def to_json(self) -> dict[str, Any]:
        """The entry of this file for `--json`."""
        return {"file": str(self.path), "messages": self.messages, "bytes": self.size, "complete": self.is_whole}


@dataclass(frozen=True)
class Written:
    """The files of `--out`, `--record` and `--rerun`; None for a file that was not requested."""

    out: OutFolder
    record: File | None = None
    rerun: File | None = None

    def to_json(self) -> dict[str, Any]:
        """The entries of all files for `--json`, by option."""
        found: dict[str, Any] = {}
        if self.out.folder is not None:
            found["out"] = {"folder": str(self.out.folder), "files": self.out.names, "missing": self.out.missing}
        files = {"record": self.record, "rerun": self.rerun}
        return found | {option: file.to_json() for option, file in files.items() if file is not None}

    def tell(self, as_json: bool) -> bool:
        """Print the files, unless the JSON output lists them, and log missing ones. Returns whether all are whole."""
        is_whole = tell_out(self.out, as_json)
        for word, file in (("recorded in", self.record), ("viewer file", self.rerun)):
            if file is not None:
                is_whole = is_whole and file.is_whole
                if not as_json:
                    typer.echo(f"{word} {file.path}: {file.messages} messages, {file.size / 1e6:.2f} MB")
        return is_whole


def tell_out(out: OutFolder, as_json: bool) -> bool:
    """Print the files of `--out`, unless the JSON output lists them, and log missing ones. Returns whether none is."""
    if out.names and not as_json:
        typer.echo(f"written to {out.folder}: {', '.join(out.names)}")
    if PICTURE in out.files and PICTURE not in out.names and not has_part("navloom_study"):
        LOG.info(f"{PICTURE} is not drawn: pip install {PARTS['navloom_study']}")
    if out.failure:
        LOG.warning(out.failure)
    return not out.failure


def record_of(recorder: Any) -> File | None:
    """The recording of a run by a `LockstepRecorder`, or None, once it has ended."""
    if recorder is None:
        return None
    writer = recorder.writer
    return File(writer.path, writer.messages, writer.size, not recorder.failure)


def rerun_of(path: Path | None, showing: Any) -> File | None:
    """The viewer's file, once it is closed."""
    if path is None or showing is None:
        return None
    counts = showing.counts
    return File(path, counts.drawn, path.stat().st_size if path.exists() else 0, not counts.file_failure)
