"""Finds and mends the files of a bag, for `bags`: its description, what is compressed, damaged or was never closed.

A bag may be hostile: names of files must not lead elsewhere, what is unpacked is bounded, and databases that compute
their rows are refused.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

from navloom.inputs import BAG_MB, YAML_MB, bytes_of, open_file, read_file, too_large
from navloom_maps import yaml_of
from navloom_recording import RecordingError

from navloom_ros.bag_salvage import LeftOut, merged_database, readable_database, salvaged_bag, salvaged_mcap, unchanging

__all__ = ["BagFiles", "bag_files"]

INFORMATION = "rosbag2_bagfile_information"
"""Top-level key of a ROS 2 bag's metadata.yaml."""
PIECE = 1 << 20
"""Bytes to unpack at once."""
DATA = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
"""Ends of the names of a ROS 2 bag's data files."""
OLD = b"#ROSRECORD"
"""Start of bags before V2.0, of 2010."""


@dataclass
class BagFiles:
    """The files to open, what the user must know of them, and the topics that a rewritten file lacks.

    Attributes:
        paths: For `rosbags`: a folder, or files of one kind.
        notes: Lines for the user.
        left_out: Type and number of messages by topic.
    """

    paths: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left_out: LeftOut = field(default_factory=dict)


def bag_files(bag: Path, folder: Path, types: frozenset[str]) -> BagFiles:
    """Check the files of a bag, and mend them as copies.

    Args:
        bag: A file, or the folder of a ROS 2 bag.
        folder: Empty folder for copies.
        types: Message types that rewritten files must keep.

    Raises:
        RecordingError: A file is missing, cannot be read, or exceeds the limit of what may be unpacked.
    """
    found = BagFiles()
    if not bag.is_dir():
        found.paths = [_mended(bag, folder, types, found)]
        return found
    described = bag / "metadata.yaml"
    about = _described(described) if described.exists() else None
    names = None if about is None else [PurePath(name).name for name in about["relative_file_paths"]]
    there = sorted(path.name for path in bag.iterdir() if path.name.endswith(DATA))
    if about is None and not there:
        raise RecordingError(f"{bag}: not a bag: expected metadata.yaml, or files that end in {', '.join(DATA)}")
    files = [bag / name for name in _present(bag, names, there, found)]
    is_sqlite = about is not None and about["storage_identifier"] == "sqlite3"
    mended = [_mended(file, folder, types, found, is_sqlite) for file in files]
    if about is None:
        found.notes.append(f"metadata.yaml is missing: all of {', '.join(path.name for path in files)} was read")
        found.paths = mended
    elif mended == [bag / n for n in names or ()] and about["storage_identifier"] and not about.get("compression_mode"):
        found.paths = [bag]
    else:
        kind = "mcap" if mended[0].suffix == ".mcap" else "sqlite3"
        # `bags.messages` finds compressed messages by themselves, whatever the description says of them.
        about = {**about, "compression_mode": "", "compression_format": "",
                 "storage_identifier": about["storage_identifier"] or kind,
                 "relative_file_paths": [path.name for path in mended]}  # fmt: skip
        for path in mended:
            if path.parent != folder:
                (folder / path.name).symlink_to(path.absolute())
        (folder / "metadata.yaml").write_text(json.dumps({INFORMATION: about}, default=str), "utf-8")
        found.paths = [folder]
    return found


def _described(described: Path) -> dict[str, Any]:
    with _readable(described):
        tree = yaml_of(read_file(described, YAML_MB, RecordingError), str(described), RecordingError)
    try:
        about: dict[str, Any] = dict(tree[INFORMATION])
        # Only names: a hostile description must not lead to files elsewhere.
        if not all(PurePath(name).name for name in about["relative_file_paths"]):
            raise TypeError
        about["storage_identifier"] = about["storage_identifier"] or ""
    except (KeyError, TypeError, ValueError, AttributeError):
        raise RecordingError(f"{described}: not the description of a ROS 2 bag; copy the bag again") from None
    return about


def _present(bag: Path, names: Sequence[str] | None, there: Sequence[str], found: BagFiles) -> list[str]:
    """Names of the data files, those of a renamed bag included. Raises RecordingError if there is none."""
    if names is None:
        return list(there)
    missing = [name for name in names if not (bag / name).exists()]
    others = [name for name in there if name not in names]
    if not missing:
        return list(names)
    if len(missing) == len(others):
        found.notes.append(f"metadata.yaml names {', '.join(missing)}: {', '.join(others)} was read in place of it")
        return [name for name in names if name not in missing] + others
    present = [name for name in names if name not in missing]
    if not present:
        raise RecordingError(f"{bag / missing[0]}: no such file; copy the bag again")
    found.notes.append(f"{', '.join(missing)} is missing: what it holds is lost; copy the bag again")
    return present


def _mended(path: Path, folder: Path, types: frozenset[str], found: BagFiles, is_sqlite: bool = False) -> Path:
    """A data file, or a copy of it that can be opened."""
    with _readable(path), open_file(path, RecordingError) as file:
        first = file.read(len(OLD))
    if first == OLD:
        raise RecordingError(
            f"{path}: a bag of the format before V2.0; rewrite it with ROS 1's `rosbag fix`, or `rosbag reindex`"
        )
    if path.suffix in (".zstd", ".zst"):
        return _mended(_unpacked(path, folder), folder, types, found, is_sqlite)
    limit = bytes_of(BAG_MB, RecordingError)
    target = folder / f"mended-{path.name.removesuffix('.active')}"
    try:
        if path.suffix == ".db3" or is_sqlite:
            merged = merged_database(path, target)
            _refuse_queries(merged)
            return readable_database(merged, target)
        rewrite = {".mcap": salvaged_mcap, ".bag": salvaged_bag, ".active": salvaged_bag}.get(path.suffix)
        why = _why_unreadable(path) if rewrite else ""
        if rewrite is None or not why:
            return path
        found.left_out.update(_rewritten(rewrite, path, target, types, limit))
    except (sqlite3.Error, UnicodeError) as error:
        raise RecordingError(f"{path}: not the database of a bag: {error}; copy the bag again") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be copied: {error.strerror or error}") from None
    if _why_unreadable(target, least=1):
        raise RecordingError(f"{path}: not a bag that can be read ({why}); expected F.bag or a ROS 2 bag's folder")
    found.notes.append(f"{path.name} cannot be opened ({why}): its records were read one by one, up to any damage")
    return target


def _why_unreadable(path: Path, least: int = 0) -> str:
    """Why `rosbags` cannot open a file with at least so many messages; empty if it can."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    try:
        with Reader2(path) if path.suffix == ".mcap" else Reader1(path) as reader:
            return "" if reader.message_count >= least else "it has no message"
    except MemoryError:
        raise
    except Exception as error:  # rosbags raises its own, and what its parsers raise
        # Its assertions about the index have no text.
        unnamed = "its index cannot be read" if isinstance(error, AssertionError) else type(error).__name__
        text = " ".join(str(error).split()).rstrip(".") or unnamed
        return text if len(text) <= 200 else f"{text[:197]}..."


def _rewritten(rewrite: Any, path: Path, target: Path, types: frozenset[str], limit: int) -> LeftOut:
    """Rewrite a file; nothing of it is left if its damage goes too far."""
    try:
        left_out: LeftOut = rewrite(path, target, types, limit)
        return left_out
    except (MemoryError, OSError, RecordingError):
        raise
    except Exception:  # as those of the writers and parsers of `rosbags` and `mcap`
        target.unlink(missing_ok=True)
        return {}


def _unpacked(path: Path, folder: Path) -> Path:
    """Unpack a file that is compressed as a whole; all unpacked files together must not exceed the limit."""
    import zstandard

    limit = bytes_of(BAG_MB, RecordingError)
    left = limit - sum(file.stat().st_size for file in folder.iterdir())
    target = folder / path.stem
    with _readable(path), open_file(path, RecordingError) as packed, target.open("wb") as file:
        source = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        try:
            # In pieces, so that a bomb is noticed before it fills memory or disk.
            while piece := source.read(PIECE):
                left -= len(piece)
                if left < 0:
                    raise RecordingError(too_large(f"{path}: unpacks to more than {limit / 1e6:g} MB", limit))
                file.write(piece)
        except zstandard.ZstdError as error:
            raise RecordingError(f"{path}: damaged: {error}; copy the bag again") from None
    return target


def _refuse_queries(path: Path) -> None:
    """Refuse a database with views or computed columns: reading one row of them may never end."""
    try:
        with closing(unchanging(path)) as database:
            for kind, name, text in database.execute("SELECT type, name, sql FROM sqlite_master LIMIT 1000"):
                is_plain = kind == "index" or (kind == "table" and str(text).upper().startswith("CREATE TABLE"))
                columns = database.execute("SELECT hidden FROM pragma_table_xinfo(?)", (name,)) if is_plain else ()
                if not is_plain or any(hidden for (hidden,) in columns):
                    raise RecordingError(f"{path}: {kind} {str(name)[:40]!r} is computed, expected plain tables")
    except (sqlite3.Error, UnicodeError) as error:
        raise RecordingError(f"{path}: not the database of a bag: {error}; copy the bag again") from None


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
