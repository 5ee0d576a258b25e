"""The documentation site: it builds without a warning and without a network, and reference and face are complete."""

from __future__ import annotations

import inspect
import io
import json
import logging
import re
import shutil
import socket
import subprocess
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import navloom
import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config
from navloom.engine.catalogue import FRAMEWORK
from navloom_sensors_sim.adapter import SensorsSim
from PIL import Image

TOP = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.once


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The site, built strictly where no connection can be made."""
    folder = tmp_path_factory.mktemp("site")

    def refuse(*address: object) -> None:
        raise AssertionError(f"the build connects to {address}")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket.socket, "connect", refuse)
        patch.chdir(TOP)
        said = io.StringIO()
        handler = logging.StreamHandler(said)
        handler.setLevel(logging.WARNING)
        logging.getLogger("mkdocs").addHandler(handler)
        try:
            build(load_config(str(TOP / "mkdocs.yml"), strict=True, site_dir=str(folder)))
        finally:
            logging.getLogger("mkdocs").removeHandler(handler)
        assert said.getvalue() == ""
        yield folder


def test_no_page_fetches_anything(site: Path) -> None:
    fetched = re.compile(r'<(?:script|img|link|iframe)[^>]*?(?:src|href)="?(https?:)?//')
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    assert [str(page) for page in pages if fetched.search(page.read_text("utf-8"))] == []


def test_every_picture_is_where_its_page_looks_for_it(site: Path) -> None:
    found = [
        (page, image)
        for page in site.rglob("*.html")
        for image in re.findall(r'<img[^>]*? src="?([^" >]+)', page.read_text("utf-8"))
        if not image.startswith("data:")
    ]
    assert len(found) >= 4
    assert [(str(page), image) for page, image in found if page.name != "404.html"
            and not (page.parent / image).is_file()] == []  # fmt: skip


def test_every_public_name_is_in_the_reference(site: Path) -> None:
    things = {name: getattr(navloom, name) for name in navloom.__all__}
    documented = {name for name, thing in things.items() if inspect.isclass(thing) or inspect.isfunction(thing)}
    pages = [*site.glob("reference/**/*.html"), site / "messages/index.html"]
    text = " ".join(page.read_text("utf-8") for page in pages)
    assert documented - set(re.findall(r'id="navloom\.(?:messages\.)?(\w+)"', text)) == set()


def test_every_name_of_a_public_package_is_in_the_reference(site: Path) -> None:
    page = (TOP / "docs" / "writing-a-plugin.md").read_text("utf-8")
    things = {}
    for package in re.findall(r"^\| `([\w.]+)` \|  \|", page, re.MULTILINE):
        made = import_module(package)
        things.update({name: getattr(made, name) for name in made.__all__})
    documented = {name for name, thing in things.items() if inspect.isclass(thing) or inspect.isroutine(thing)}
    names = documented - {*navloom.__all__, "navloom_register"}
    text = " ".join(page.read_text("utf-8") for page in site.glob("reference/**/*.html"))
    assert len(names) > 80
    assert names - set(re.findall(r'id="navloom[\w.]*\.(\w+)"', text)) == set()


def test_the_reference_shows_types_and_meanings_of_shared_entries(site: Path) -> None:
    page = (site / "reference/mapper/index.html").read_text("utf-8")
    for field in ("sweeps", "scans"):
        assert re.search(
            rf">{field}</span></code></td>\s*<td>\s*<code>.{{1,600}}?New data, in stamp order", page, re.DOTALL
        )


def test_every_page_is_in_the_navigation(site: Path) -> None:
    home = (site / "index.html").read_text("utf-8")
    listed = {link.rstrip("/") for link in re.findall(r'<a href="([^"#:]+)" class="md-nav__link">', home)}
    pages = {page.stem for page in (TOP / "docs").glob("*.md")}
    assert pages - listed == set()


def test_the_generated_parts_of_the_messages_are_on_their_page(site: Path) -> None:
    page = (site / "messages/index.html").read_text("utf-8")
    assert "<!-- generated" not in page
    for part in ('id="odometry"', "Dead reckoning of the platform", "Run clock of the measurement.", "<td>634</td>"):
        assert part in page


def test_every_stream_is_in_the_reference(site: Path) -> None:
    page = (site / "reference/streams/index.html").read_text("utf-8")
    for port in FRAMEWORK.ports():
        cells = (f"<code>{port.role}</code>", f"<code>{port.name}</code>", f"<a [^>]*>{port.carries.__name__}</a>")
        assert re.search(r"\s*".join(f"<td>{cell}</td>" for cell in cells), page), port


def test_the_lab_is_not_on_the_site(site: Path) -> None:
    assert not (site / "lab").exists()
    assert "<code>docs/lab/fault-campaigns.md</code>" in (site / "faults/index.html").read_text("utf-8")


def test_every_sensor_setting_is_in_the_reference_and_printed(
    site: Path, in_process: Callable[..., tuple[int, str, str]]
) -> None:
    page = (site / "reference/sensors/index.html").read_text("utf-8")
    _, printed, _ = in_process("plugins", "platform.sensors_sim")
    for kind, model in SensorsSim.sensor_settings.items():
        assert f"sensors_sim: {kind}" in page and f"sensor of kind {kind} gives" in printed
        for name, field in model.model_fields.items():
            assert f"<code>{name}</code>" in page and name in printed.split()
            assert field.description and field.description in " ".join(printed.split())


def test_the_front_page_shows_a_drive_that_is_light(site: Path) -> None:
    home = (site / "index.html").read_text("utf-8")
    assert re.search(r'<source media="\(prefers-reduced-motion: reduce\)" srcset="pictures/drive.png"', home)
    assert 'src="pictures/drive.webp"' in home
    assert (site / "pictures/drive.webp").stat().st_size < 500_000
    with Image.open(site / "pictures/drive.webp") as loop:
        assert getattr(loop, "n_frames", 1) > 30


def test_the_site_has_a_logo_and_an_icon_of_its_own(site: Path) -> None:
    home = (site / "index.html").read_text("utf-8")
    assert 'rel="icon" href="site/favicon.svg"' in home and 'src="site/logo.svg"' in home
    assert (site / "site/favicon.svg").exists() and (site / "site/logo.svg").exists()


def test_blocks_say_their_language_to_the_copy_button(site: Path) -> None:
    tour = (site / "tour/index.html").read_text("utf-8")
    blocks = re.findall(r'<div class="([\w-]* ?)highlight">', tour)
    assert {"language-sh ", "language-console ", "language-toml "} <= set(blocks) and "" not in blocks


@pytest.mark.parametrize("words", ["lost", "stuck", "map shifted"])
def test_a_search_for_trouble_finds_the_page_of_remedies_first(site: Path, words: str) -> None:
    entries = json.loads((site / "search/search_index.json").read_text("utf-8"))["docs"]
    found = {
        entry["location"].partition("/#")[0].strip("/"): entry.get("boost", 1.0)
        for entry in entries
        if all(word in entry["text"].lower() + entry["title"].lower() for word in words.split())
    }
    assert max(found, key=lambda page: found[page]) == "troubleshooting"


def test_every_date_of_the_comparison_leads_to_its_source(site: Path) -> None:
    page = (site / "frameworks/index.html").read_text("utf-8")
    rows = re.findall(r"<td[^>]*>[^|]*?(\d{4}-\d\d-\d\d)(</a>)?</td>", page)
    assert len(rows) >= 130 and all(link for _, link in rows)


TERMINAL = """lab$ navloom up robot.toml   # comes up
up
$ navloom status
r1: driving
"""


@pytest.mark.parametrize(
    ("language", "text", "copied"),
    [
        ("console", TERMINAL, "navloom up robot.toml\nnavloom status"),
        ("sh", "# first\nnavloom run paper  # some s\n\nnavloom report a#b\n", "navloom run paper\nnavloom report a#b"),
    ],
)
def test_a_copy_button_copies_commands_alone(tmp_path: Path, language: str, text: str, copied: str) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("needs a browser")
    page = tmp_path / "page.html"
    page.write_text(
        f"<div class='language-{language}'><button data-clipboard-target='#c'></button><code id=c>{text}</code></div>"
        f"<script>{(TOP / 'docs/site/copy.js').read_text('utf-8')}\n"
        "const button = document.querySelector('button'); button.click(); "
        "document.title = JSON.stringify(button.dataset.clipboardText)</script>",
        "utf-8",
    )
    words = [
        browser,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path}",
        "--dump-dom",
        page.as_uri(),
    ]
    shown = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False).stdout
    title = re.search(r"<title>(.*?)</title>", shown)
    assert title is not None and json.loads(title[1]) == copied
