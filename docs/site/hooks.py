"""What mkdocs builds beside the files of `docs/`: pages of the top folder, the examples, and the reference."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files
from navloom.messages import SCHEMAS
from reference import PAGES

TOP = Path(__file__).resolve().parents[2]
SHOWN = {"README.md": "index.md", "CONTRIBUTING.md": "CONTRIBUTING.md", "CHANGELOG.md": "CHANGELOG.md"}
"""Pages of the top folder, and their places on the site."""
FOLDER = re.compile(r"\[([^]]+)\]\([^)]+/\)")
"""A link to a folder: a site has none."""
LAB = re.compile(r"\[([^]]+)\]\(lab/([\w-]+\.md)(?:#[\w-]+)?\)")
"""A link to the lab, which is in the repository only."""
FILES = ("LICENSE", "CITATION.cff")
"""Further files of the top folder that pages link to."""
LINK = re.compile(r'(\]\(|src=")(?!https?:|#)([^)"#]+)')


def on_files(files: Files, config: Any) -> Files:
    """Add what is not in `docs/`."""
    for source, target in SHOWN.items():
        text = LINK.sub(lambda found: found[1] + _from_top(found[2]), (TOP / source).read_text("utf-8"))
        files.append(File.generated(config, target, content=text))
    for path in sorted((TOP / "examples").rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            files.append(File.generated(config, path.relative_to(TOP).as_posix(), abs_src_path=str(path)))
    for name in FILES:
        files.append(File.generated(config, name, abs_src_path=str(TOP / name)))
    for target, make in PAGES.items():
        files.append(File.generated(config, f"reference/{target}", content=make()))
    return files


def on_page_markdown(markdown: str, page: Any, **given: Any) -> str:
    """Links that leave `docs/`, to where the site has what they name; and the messages, as types lead to them."""
    if page.file.src_uri == "messages.md":
        markdown = re.sub(r"^### (\w+)$", _with_anchor, markdown, flags=re.MULTILINE)
    return LINK.sub(lambda found: found[1] + _from_docs(found[2]), LAB.sub(_in_repository, FOLDER.sub(r"\1", markdown)))


def _in_repository(link: re.Match[str]) -> str:
    """The file that a link to the lab names, in words."""
    file = f"`docs/lab/{link[2]}`"
    return file if link[1].endswith(".md") else f"{link[1]} ({file})"


def _with_anchor(heading: re.Match[str]) -> str:
    """A message's heading, below the name by which the types of the reference link to it, and above its constructor."""
    cls: Any = SCHEMAS.get(f"navloom.{heading[1]}")
    if cls is None:
        return heading[0]
    made = ", ".join(
        field.name if field.default is dataclasses.MISSING else f"{field.name}={field.default!r}"
        for field in dataclasses.fields(cls)
    )
    return f"[](){{#navloom.messages.{heading[1]}}}\n{heading[0]}\n\n`{heading[1]}({made})`"


def _from_top(target: str) -> str:
    return SHOWN.get(target, target.removeprefix("docs/"))


def _from_docs(target: str) -> str:
    return _from_top(target.removeprefix("../")) if target.startswith(("../examples/", "../README")) else target
