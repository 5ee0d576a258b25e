"""How a scheme of worlds treats files: one that is missing, one with junk, and text in UTF-8."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory

from navloom.geometry.world import World

from navloom_check.check_bench import Bench
from navloom_check.checks import check
from navloom_check.contract.verbless_plugins import own_line
from navloom_check.findings import Finding
from navloom_check.side_effects import GUARD

__all__ = ["CHECKS"]

MISSING = "missing"
ENDINGS = ("", ".txt", ".json", ".toml", ".yaml", ".csv", ".xml", ".pgm", ".png")
JUNK = {
    "junk": b"this is no world\n= ] 17 [ {\n\x00\xff\xfe junk \x80\n",
    "text": "this is no world, nor is thäs\n= ] 17 [ {\n".encode(),
}
"""Contents of files that are no world in any format: of bytes, and of UTF-8 text."""


@check("contract", {"scheme"}, "It refuses a file that is missing or holds junk, and it reads text as UTF-8.")
def scheme_files(bench: Bench) -> Iterator[Finding]:
    """Each argument is the name of a file in the base folder, with the endings of usual formats."""
    with TemporaryDirectory() as folder:
        for name, contents in JUNK.items():
            for ending in ENDINGS:
                (Path(folder) / (name + ending)).write_bytes(contents)
        for name in (MISSING, *JUNK):
            for ending in ENDINGS:
                if found := list(_given(bench, Path(folder), name + ending)):
                    yield from found
                    return


def _given(bench: Bench, folder: Path, name: str) -> Iterator[Finding]:
    """Findings for one file."""
    GUARD.opened.clear()
    world = raised = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", EncodingWarning)
        try:
            with GUARD.within("the scheme"):
                world = bench.subject.thing(name, folder)
        except ValueError:
            pass
        except Exception as error:
            raised = error
    tried = [path for path in GUARD.opened if os.path.realpath(path).startswith(os.path.realpath(folder))]
    own = [one for one in caught if issubclass(one.category, EncodingWarning) and _is_own(bench, one.filename)]
    if own:
        place = f"{PurePath(own[0].filename).name}:{own[0].lineno}"
        yield Finding("reads text in the encoding of the locale", 'encoding="utf-8"', place, f"argument {name!r}")
    if raised is not None and tried and not name.startswith(MISSING):
        yield Finding(
            f"raises {type(raised).__name__} for a file of junk: {str(raised)[:80]}",
            "ValueError, with the file and what was expected in it", own_line(bench, raised), f"argument {name!r}",
        )  # fmt: skip
    if elsewhere := [path for path in GUARD.opened if PurePath(path).name == name and path not in tried]:
        yield Finding(
            f"looks for the file at {elsewhere[0]}", "a path relative to the folder that it is given: base / argument",
            given=f"argument {name!r}",
        )  # fmt: skip
    if isinstance(world, World) and tried:
        what = "that is missing" if name.startswith(MISSING) else "of junk"
        yield Finding(f"gives a world of {len(world.obstacles)} obstacles for a file {what}",
                      "ValueError, with the file and what was expected in it", given=f"argument {name!r}")  # fmt: skip


def _is_own(bench: Bench, file: str) -> bool:
    """Whether a file is the module of the plugin."""
    return any(getattr(module, "__file__", None) == file for name, module in list(sys.modules.items())
               if bench.subject.is_own(name))  # fmt: skip


CHECKS = (scheme_files,)
