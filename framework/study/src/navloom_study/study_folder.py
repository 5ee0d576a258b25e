"""The folder of a study: the request, a journal that grows as episodes end, and the final tables."""

from __future__ import annotations

import csv
import fcntl
import io
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import TracebackType
from typing import Any

from navloom.config import ConfigError
from navloom.errors import NavloomError
from navloom.files import write_each, write_whole
from navloom.inputs.bounds import IMAGE_MB, TEXT_MB, read_file
from navloom.inputs.texts import json_of
from navloom.inputs.typed_json import from_builtins

from navloom_study.episode_key import EpisodeKey
from navloom_study.episode_rows import Row
from navloom_study.fleet_episodes import MEMBERS, member_table
from navloom_study.openloop import METHOD
from navloom_study.tracks import FOLDER, file_of

__all__ = ["Compared", "OpenLoopLine", "StudyError", "StudyFolder", "open_loop_lines", "open_loop_table", "rows_of",
           "table_of"]  # fmt: skip

SHOWN = 3
"""Most differences that an error names."""


class StudyError(NavloomError, RuntimeError):
    """The study can no longer be stored; ended episodes are kept. The text says why, and what to do."""

    exit_code = 1


class StudyFolder:
    """Writes `study.json`, `journal.jsonl`, `trails/`, `episodes.csv` and `timing.json`; without a folder nothing.

    Args:
        folder: The folder, or None.
        request: The request in the form of `study.json`; a folder with another request is refused.

    Raises:
        ConfigError: On entering: the folder holds another study or other files, is in use, or cannot be written.

    Attributes:
        missing: Why a table was not written, by name.
    """

    def __init__(self, folder: Path | None, request: dict[str, Any]) -> None:
        # Through JSON, so that it compares equal to the stored one: tuples become lists.
        self.folder, self.request = folder, json.loads(json.dumps(request))
        self.rows: dict[EpisodeKey, Row] = {}
        self.missing: dict[str, str] = {}
        self._journal: io.FileIO | None = None

    def __enter__(self) -> StudyFolder:
        if self.folder is not None:
            try:
                self._open(self.folder)
            except OSError as error:
                self._close()
                raise ConfigError(f"--out {self.folder}: cannot be used: {error.strerror}; name a folder") from None
            except ConfigError:
                self._close()
                raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def keep(self, row: Row) -> None:
        """Store an ended episode: it is in the journal when this returns.

        Raises:
            StudyError: The disk is full; the journal ends with the previous episode.
        """
        if self._journal is not None and self.folder is not None:
            try:
                self._write(self._journal, row)
            except OSError as error:
                place = error.filename or self.folder / "journal.jsonl"
                raise StudyError(
                    f"--out {self.folder}: {place}: {error.strerror}; {len(self.rows)} episodes are kept: make room, "
                    "and the same command goes on from there"
                ) from None
        # Tracks of thousands of episodes would fill the memory.
        self.rows[row.key] = replace(row, track=b"")

    def _write(self, journal: io.FileIO, row: Row) -> None:
        if row.track and self.folder is not None:
            (self.folder / FOLDER).mkdir(exist_ok=True)
            write_whole(self.folder / FOLDER / file_of(row.key), row.track)
        rest = memoryview(json.dumps(row.to_json(), ensure_ascii=False).encode() + b"\n")
        end = journal.seek(0, io.SEEK_END)
        try:
            while rest:
                rest = rest[journal.write(rest) :]
        except OSError:
            # A full disk must leave whole lines only.
            journal.truncate(end)
            raise

    def finish(
        self, rows: Sequence[Row], metrics: Sequence[str], timing: dict[str, Any], open_loop: Sequence[Row] = (),
        member_metrics: Sequence[str] = (),
    ) -> list[str]:  # fmt: skip
        """Write the tables of a complete study atomically. Returns the names of all files in the folder."""
        if self.folder is None:
            return []
        tables = {"episodes.csv": table_of(rows, metrics), "timing.json": json.dumps(timing, indent=1) + "\n"}
        if open_loop:
            tables["open_loop.csv"] = open_loop_table(open_loop, self.request["open_loop"]["shadows"])
        if member_metrics:
            tables[MEMBERS] = member_table(rows, member_metrics)
        self.missing = write_each(self.folder, tables)
        names = dict.fromkeys(["episodes.csv", "study.json", "timing.json", "journal.jsonl", *tables])
        found = [name for name in names if name not in self.missing]
        return [*found, FOLDER] if (self.folder / FOLDER).is_dir() else found

    def _open(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        told, journal = folder / "study.json", folder / "journal.jsonl"
        foreign = [entry.name for entry in folder.iterdir() if entry.stat().st_size or entry.is_dir()]
        if foreign and not told.exists():
            raise ConfigError(f"--out {folder}: holds {foreign[0]} and no study; name an empty or a new folder")
        self._journal = io.FileIO(journal, "a+b")
        try:
            # Two studies would mix their lines.
            fcntl.flock(self._journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(f"--out {folder}: another navloom compare writes there; name another") from None
        if told.exists():
            self._check(told)
            self._read(journal)
        else:
            write_whole(told, json.dumps(self.request, indent=1, ensure_ascii=False) + "\n")

    def _check(self, told: Path) -> None:
        try:
            before = json_of(read_file(told, TEXT_MB, ConfigError), str(told), ValueError)
        except ConfigError:
            raise
        except ValueError as error:
            raise ConfigError(f"{error}; name another folder with --out") from None
        found = list(_differences(before, self.request))
        if found:
            more = f" (and {len(found) - SHOWN} more)" if len(found) > SHOWN else ""
            raise ConfigError(
                f"--out {self.folder}: holds another study: {'; '.join(found[:SHOWN])}{more}; "
                "repeat the same request to continue it, or name another folder"
            )

    def _read(self, journal: Path) -> None:
        """Read the episodes of earlier calls; the journal is cut at the first damaged line."""
        whole = 0
        for line in io.BytesIO(read_file(journal, IMAGE_MB, ConfigError)):
            try:
                row = Row.from_json(json_of(line, str(journal), ValueError)) if line.endswith(b"\n") else None
            except ValueError:
                row = None
            # What follows a damaged line may be damaged, too: these episodes run again.
            if row is None or not self._fits(row):
                break
            self.rows[row.key] = row
            whole += len(line)
        os.truncate(journal, whole)

    def _fits(self, row: Row) -> bool:
        """Whether it has all columns of this study's tables."""
        if row.key.method == METHOD:
            shadows = self.request.get("open_loop", {}).get("shadows", {})
            return all(shadow.instance in shadows for shadow in row.shadows)
        own = self.request.get("member_metrics", ())
        are_whole = all(name in one.metrics for one in row.members for name in own)
        return are_whole and all(name in row.metrics for name in self.request.get("metrics", ()))

    def _close(self) -> None:
        if self._journal is not None:
            self._journal.close()
            self._journal = None


def table_of(rows: Sequence[Row], metrics: Sequence[str]) -> str:
    """Rows as CSV: numbers with 12 digits, empty if a metric is not defined."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "world", "seed", "outcome", "reason", *metrics, "trace_sha256"])
    for row in rows:
        values = ["" if (value := row.metrics[name]) is None else f"{value:.12g}" for name in metrics]
        key = row.key
        writer.writerow([key.method, key.world, key.seed, row.outcome, row.reason, *values, row.trace_sha256])
    return text.getvalue()


def rows_of(table: str, metrics: Sequence[str]) -> list[Row]:
    """Rows from the text of `table_of`.

    Raises:
        KeyError: A column is missing; ValueError, TypeError: a value is missing or no number.
    """
    return [
        Row(
            EpisodeKey(line["method"], line["world"], int(line["seed"])),
            line["outcome"],
            line["reason"],
            {name: float(line[name]) if line[name] != "" else None for name in metrics},
            line["trace_sha256"],
        )
        for line in csv.DictReader(io.StringIO(table, newline=""))
    ]


@dataclass(frozen=True)
class Compared:
    """A shadow's differences from the baseline in one quantity.

    Attributes:
        ticks: Number of ticks compared; None if there is nothing to compare.
        differing_share: Share of the ticks in which any quantity differs.
        rms, max: Root mean square and maximum of the difference, in the quantity's unit.
    """

    ticks: int | None
    differing_share: float | None
    rms: float | None
    max: float | None


@dataclass(frozen=True, kw_only=True)
class OpenLoopLine:
    """A line of `open_loop.csv`: a shadow in one world with one seed, and one quantity; its fields are the columns.

    Attributes:
        method, role, world, seed, outcome: The shadow's method and role, and the episode.
        ticks, differing_share, rms, max: See `all_ticks`.
        unanswered: Number of ticks in which only one of the two answered.
        first_differing_s: Time of the first tick that differs, s.
        driving_ticks, driving_differing_share, driving_rms, driving_max: See `while_driving`.
        quantity: Name of the quantity; empty if nothing was compared.
        trace_sha256: Hash of the episode's trace.
    """

    method: str
    role: str
    world: str
    seed: int
    outcome: str
    ticks: int
    unanswered: int
    differing_share: float | None = None
    first_differing_s: float | None = None
    driving_ticks: int | None = None
    driving_differing_share: float | None = None
    quantity: str = ""
    rms: float | None = None
    max: float | None = None
    driving_rms: float | None = None
    driving_max: float | None = None
    trace_sha256: str = ""

    @property
    def all_ticks(self) -> Compared:
        """Differences over all ticks."""
        return Compared(self.ticks, self.differing_share, self.rms, self.max)

    @property
    def while_driving(self) -> Compared:
        """Differences over the ticks in which the active avoider drove."""
        return Compared(self.driving_ticks, self.driving_differing_share, self.driving_rms, self.driving_max)


def open_loop_table(rows: Sequence[Row], methods: Mapping[str, str]) -> str:
    """Open-loop rows as CSV, one line a shadow, world, seed and quantity; `methods` maps instances to methods."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in fields(OpenLoopLine)])
    for row in rows:
        for line in _open_loop_lines(row, methods):
            values = [getattr(line, column.name) for column in fields(line)]
            writer.writerow([f"{value:.12g}" if isinstance(value, float) else value for value in values])
    return text.getvalue()


def _open_loop_lines(row: Row, methods: Mapping[str, str]) -> Iterator[OpenLoopLine]:
    for shadow in row.shadows:
        drove = shadow.driving
        for quantity in shadow.differences or [""]:
            sizes = shadow.differences.get(quantity)
            driving = None if drove is None else drove.differences.get(quantity)
            yield OpenLoopLine(
                method=methods[shadow.instance],
                role=shadow.role,
                world=row.key.world,
                seed=row.key.seed,
                outcome=row.outcome,
                ticks=shadow.ticks,
                unanswered=shadow.unanswered,
                differing_share=shadow.differing_share,
                first_differing_s=shadow.first_differing_s,
                driving_ticks=None if drove is None else drove.ticks,
                driving_differing_share=None if drove is None else drove.differing_share,
                quantity=quantity,
                rms=None if sizes is None else sizes.rms,
                max=None if sizes is None else sizes.max,
                driving_rms=None if driving is None else driving.rms,
                driving_max=None if driving is None else driving.max,
                trace_sha256=row.trace_sha256,
            )


def open_loop_lines(table: str) -> list[OpenLoopLine]:
    """Lines from the text of `open_loop_table`. Raises ValueError."""
    return [
        from_builtins(OpenLoopLine, {name: text for name, text in line.items() if text}, from_texts=True)
        for line in csv.DictReader(io.StringIO(table, newline=""))
    ]


def _differences(before: Any, now: Any, place: str = "") -> list[str]:
    """Differences of two requests: place, old and new value."""
    if isinstance(before, dict) and isinstance(now, dict):
        found: list[str] = []
        for key in [*before, *(key for key in now if key not in before)]:
            inner = f"{place}.{key}" if place else str(key)
            if key in before and key in now:
                found += _differences(before[key], now[key], inner)
            else:
                found.append(f"{inner} is new" if key in now else f"{inner} is gone")
        return found
    if before == now:
        return []
    return [f"{place} was {_brief(before)}, now {_brief(now)}"]


def _brief(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 80 else text[:77] + "…"
