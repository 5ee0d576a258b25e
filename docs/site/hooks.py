"""What mkdocs builds beside the files of `docs/`: pages of the top folder, the examples, and the reference."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from message_tables import with_parts
from mkdocs.structure.files import File, Files
from mkdocs.utils import get_relative_url
from reference import PAGES

TOP = Path(__file__).resolve().parents[2]
SHOWN = {"README.md": "index.md", "CONTRIBUTING.md": "CONTRIBUTING.md", "CHANGELOG.md": "CHANGELOG.md"}
"""Pages of the top folder, and their places on the site."""
FOLDER = re.compile(r"\[([^]]+)\]\((?!https?:)[^)]+/\)")
"""A link to a folder of the project: a site has none."""
LAB = re.compile(r"\[([^]]+)\]\(lab/([\w-]+\.md)(?:#[\w-]+)?\)")
"""A link to the lab, which is in the repository only."""
FILES = ("LICENSE", "CITATION.cff")
"""Further files of the top folder that pages link to."""
LOOP = """<picture><source media="(prefers-reduced-motion: reduce)" srcset="pictures/drive.png">
<img src="pictures/drive.webp" \\1></picture>"""
"""The front page's picture moves; for whom motion disturbs, it is the README's."""
WEIGHTS = {"troubleshooting.md": 2.0, "operating.md": 1.5, "reference/": 0.5, "CHANGELOG.md": 0.2}
"""Weights in the search, more for what one needs in a hurry, less for lists: beginning of the path -> factor."""
IMAGE = re.compile(r'(<img src=")(?!https?:)([^"]+)')
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
    """Links that leave `docs/`, weights in the search, the front page's loop, and the tables of messages."""
    uri = page.file.src_uri
    page.meta.setdefault("search", {"boost": next((WEIGHTS[key] for key in WEIGHTS if uri.startswith(key)), 1.0)})
    if uri == "index.md":
        markdown = re.sub(r'<img src="pictures/drive.png" ([^>]+)>', LOOP, markdown)
    if uri == "messages.md":
        markdown = with_parts(markdown)
    text = LINK.sub(lambda found: found[1] + _from_docs(found[2]), LAB.sub(_in_repository, FOLDER.sub(r"\1", markdown)))
    return IMAGE.sub(lambda found: found[1] + _from_page(found[2], page.file), text)


def _from_page(target: str, file: File) -> str:
    """The address of a picture, as the page's own address needs it; mkdocs does so for Markdown, not for HTML."""
    return get_relative_url(posixpath.normpath(posixpath.join(posixpath.dirname(file.src_uri), target)), file.url)


def _in_repository(link: re.Match[str]) -> str:
    """The file that a link to the lab names, in words."""
    file = f"`docs/lab/{link[2]}`"
    return file if link[1].endswith(".md") else f"{link[1]} ({file})"


def _from_top(target: str) -> str:
    return SHOWN.get(target, target.removeprefix("docs/"))


def _from_docs(target: str) -> str:
    above = target.removeprefix("../")
    leaves = above != target and (above.startswith("examples/") or above in (*SHOWN, *FILES))
    return _from_top(above) if leaves else target
