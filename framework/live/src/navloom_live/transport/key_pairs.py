"""Installs pairs of key and certificate in a folder, so that a pair fits together at every moment.

Two files cannot be replaced at once, and a process that is killed between the two would leave a key beside a
certificate that is not its own. So NAME.pem and NAME-key.pem are links through one link, `.pairs/NAME`, to a folder
with both files. A renewal switches that one link.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

__all__ = ["files_of", "place_pair", "sweep_pairs"]

SHELF = ".pairs"
"""Folder of the pairs."""


def files_of(name: str) -> tuple[str, str]:
    """Key and certificate of an identity. A process that watches the certificate must find its key in place."""
    return f"{name}-key.pem", f"{name}.pem"


def place_pair(draft: Path, folder: Path, name: str) -> Callable[[], None]:
    """Move a new pair into place.

    Args:
        draft: Folder with the two new files, on the same file system.
        folder: The folder of certificates.
        name: Name of the identity.

    Returns:
        Puts the pair back that was there before, or removes the new one.

    Raises:
        OSError: It cannot be written; the earlier pair is in place.
    """
    shelf = folder / SHELF
    shelf.mkdir(mode=0o700, exist_ok=True)
    link = shelf / name
    visible = [folder / file for file in files_of(name)]
    if all(path.exists() for path in visible) and not all(path.is_symlink() for path in visible):
        # Plain files, or one after a command that was killed: both must be links before the link is switched.
        _link(draft, link, _stored(shelf, folder, name, shutil.copy2))
        _lead_to(draft, folder, name)
    before = os.readlink(link) if link.is_symlink() else None

    def undo() -> None:
        if before is not None:
            _link(draft, link, before)
            return
        for path in (link, *visible):
            path.unlink(missing_ok=True)

    try:
        _link(draft, link, _stored(shelf, draft, name, Path.replace))
        _lead_to(draft, folder, name)
    except OSError:
        undo()
        raise
    return undo


def sweep_pairs(folder: Path) -> None:
    """Remove pairs that no link leads to: replaced ones, and those of a command that was killed."""
    shelf = folder / SHELF
    if not shelf.is_dir():
        return
    for link in [path for path in shelf.iterdir() if path.is_symlink()]:
        if not any((folder / file).exists() for file in files_of(link.name)):
            link.unlink()  # the identity was revoked
    used = {os.readlink(path) for path in shelf.iterdir() if path.is_symlink()}
    for path in shelf.iterdir():
        if not path.is_symlink() and path.name not in used:
            shutil.rmtree(path, ignore_errors=True)
    if not used:
        shelf.rmdir()


def _stored(shelf: Path, source: Path, name: str, move: Callable[[Path, Path], object]) -> str:
    """Move or copy a pair into a folder of its own on the shelf; returns its name."""
    # On the same file system, as a move across two of them is a copy.
    place = Path(tempfile.mkdtemp(dir=shelf, prefix=f"{name}."))
    for file in files_of(name):
        move(source / file, place / file)
    return place.name


def _lead_to(draft: Path, folder: Path, name: str) -> None:
    """Make both files links to those of the pair on the shelf, unless they are."""
    for file in files_of(name):
        wanted = f"{SHELF}/{name}/{file}"
        path = folder / file
        if not path.is_symlink() or os.readlink(path) != wanted:
            _link(draft, path, wanted)


def _link(draft: Path, path: Path, target: str) -> None:
    """Make or replace a symbolic link atomically."""
    made = draft / f"link.{path.name}"
    made.unlink(missing_ok=True)
    made.symlink_to(target)
    # `replace` is atomic, `symlink_to` cannot overwrite.
    made.replace(path)
