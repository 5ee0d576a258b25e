"""Files of a config's world and map, stored in the recording so that it can be replayed on another host."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from navloom.config import Loaded
from navloom.config.schema import Config
from navloom.inputs.bounds import YAML_MB, read_file
from navloom.parts import part
from navloom.plugins.discovery import scheme_of

from navloom_recording.reader import Recording
from navloom_recording.recording_header import RecordingError

__all__ = ["world_files", "with_world"]

LARGEST = 4 << 20
"""Largest file that is stored in a recording, bytes."""
PLACES = ("world", "map")


def world_files(loaded: Loaded) -> dict[str, bytes]:
    """Contents of the files of the world and the map, by attachment name, if they are small enough."""
    found: dict[str, bytes] = {}
    for place in PLACES:
        path = _file(loaded, place)
        for one in (path, _image(path)):
            if one is not None and one.is_file() and one.stat().st_size <= LARGEST:
                found[f"{place}/{one.name}"] = one.read_bytes()
    return found


def with_world(recording: Recording, loaded: Loaded, folder: Path) -> Loaded:
    """The config, with its world and map taken from the recording if their files no longer exist.

    Args:
        recording: The recording with the files.
        loaded: The recording's config.
        folder: Folder to write the files to.
    """
    tree: dict[str, Any] = loaded.config.model_dump(mode="json", exclude_unset=True)
    for place in PLACES:
        path = _file(loaded, place)
        if path is None or path.exists():
            continue
        data = recording.attachment(f"{place}/{path.name}")
        if data is not None:
            kept = folder / path.name
            kept.write_bytes(data)
            image = _image(kept)
            beside = recording.attachment(f"{place}/{image.name}") if image is not None else None
            if image is not None and beside is not None:
                image.write_bytes(beside)
            tree[place]["ref"] = tree[place]["ref"].replace(_argument(tree[place]["ref"]), str(kept))
    return replace(loaded, config=Config.model_validate(tree))


def _image(path: Path | None) -> Path | None:
    """The image beside a map's .yaml."""
    if path is None or path.suffix not in (".yaml", ".yml") or not path.is_file():
        return None
    text = part("navloom_maps.yaml_text", str(path)).yaml_of(
        read_file(path, YAML_MB, RecordingError), str(path), RecordingError
    )
    name = text.get("image") if isinstance(text, dict) else None
    # Only beside the .yaml: a recording must not pack, or overwrite, files elsewhere.
    return path.parent / name if isinstance(name, str) and Path(name).name == name else None


def _file(loaded: Loaded, place: str) -> Path | None:
    table = getattr(loaded.config, place)
    argument = "" if table is None else _argument(table.ref)
    return (loaded.base_of(f"{place}.ref") / argument) if argument else None


def _argument(reference: str) -> str:
    """Path within a reference; empty if it names no file."""
    _, argument = scheme_of(reference)
    return argument.partition("#")[0].partition("?")[0]
