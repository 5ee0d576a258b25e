"""Writes a self-contained HTML page: no scripts or further files, suitable for screens and for A4."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

__all__ = ["Section", "code", "figure", "folded", "heading", "legend", "listing", "page", "panels", "paragraph",
           "table"]  # fmt: skip

STYLE = """
:root { --ink: #1a1a1a; --soft: #5c5c5c; --line: #d4d4d4; --wash: #f4f6f8; --mark: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1.25rem 4rem; max-width: 62rem; color: var(--ink); background: #fff;
  font: 15px/1.5 "DejaVu Sans", "Segoe UI", "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .4rem; }
h2 { font-size: 1.2rem; margin: 2.4rem 0 .6rem; padding-top: .6rem; border-top: 2px solid var(--ink); }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; }
p, ul, ol { margin: .5rem 0; }
nav ul { list-style: none; padding: 0; display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; font-size: .9rem; }
a { color: var(--mark); }
code { font: .86em/1.45 "DejaVu Sans Mono", Menlo, Consolas, monospace; overflow-wrap: anywhere; }
pre { background: var(--wash); border-left: 3px solid var(--mark); padding: .5rem .75rem; margin: .4rem 0;
  white-space: pre-wrap; overflow-wrap: anywhere; }
.scroll { overflow-x: auto; margin: .7rem 0 1.1rem; }
table { border-collapse: collapse; font-size: .82rem; line-height: 1.35; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--soft); padding: 0 0 .35rem; font-size: .95em; }
th, td { padding: .25rem .55rem; text-align: right; vertical-align: top; border-bottom: 1px solid var(--line); }
th { border-bottom: 1.5px solid var(--ink); font-weight: 600; white-space: pre-line; }
tbody th { border-bottom: 1px solid var(--line); font-weight: 400; }
th.text, td.text, tbody th { text-align: left; }
td { white-space: nowrap; }
td.text { white-space: normal; overflow-wrap: break-word; }
.detail { display: block; color: var(--soft); font-size: .88em; white-space: nowrap; }
td.text .detail { white-space: normal; overflow-wrap: anywhere; }
tr.marked { background: #fff6e0; }
figure { margin: 1rem 0 1.4rem; }
figure svg { width: 100%; height: auto; display: block; }
.panels { display: grid; gap: .8rem 1.2rem; align-items: start;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, var(--least)), 1fr)); }
.panel { overflow-x: auto; min-width: 0; }
@media (min-width: 52rem) { .panel.large { grid-column: span 2; grid-row: span 2; } }
.keys { display: flex; flex-wrap: wrap; gap: .1rem 1.1rem; font-size: .86rem; margin: .3rem 0 .5rem; }
.keys svg { display: inline-block; width: 2.2em; height: .8em; vertical-align: middle; margin-right: .35em; }
details { margin: .7rem 0; } summary { cursor: pointer; font-weight: 600; }
figcaption { color: var(--soft); font-size: .86rem; margin-top: .35rem; max-width: 50rem; }
.verdict { border-left: 3px solid var(--mark); background: var(--wash); padding: .5rem .75rem; margin: .6rem 0;
  font-size: 1.05rem; }
.note { background: #fff6e0; border-left: 3px solid #e69f00; padding: .5rem .75rem; margin: .8rem 0; }
@page { size: A4; margin: 14mm 13mm; }
@media print {
  body { font-size: 9.5pt; max-width: none; padding: 0; }
  .scroll { overflow: visible; }
  table { font-size: 7.4pt; }
  th, td { padding: 2px 4px; }
  h2 { break-after: avoid; } h3 { break-after: avoid; }
  figure, tr, pre, .note, .whole { break-inside: avoid; }
  h3 + p, h3 + .scroll, tbody tr:nth-child(-n+2) { break-before: avoid; }
  thead { display: table-header-group; }
  a { color: inherit; text-decoration: none; }
  nav { display: none; }
}
"""
NARROW, LEAST = 350.0, 250.0
"""Widest picture that is only scaled on a narrow screen, and its least width there, points."""
SHORT = 14
"""Most rows of a table that is kept on one printed page; longer tables repeat their heads on each page."""


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes:
        title: Its heading.
        body: HTML from the functions of this module.
    """

    title: str
    body: str


def page(title: str, sections: Sequence[Section], lead: str = "") -> str:
    """The HTML of a page.

    Args:
        title: Title, as plain text.
        sections: Sections in order; a table of contents is at the top, on screens only.
        lead: HTML above the first section.
    """
    anchors = [f"s{number}" for number in range(1, len(sections) + 1)]
    links = "".join(
        f'<li><a href="#{anchor}">{escape(section.title)}</a></li>'
        for anchor, section in zip(anchors, sections, strict=True)
    )
    parts = "".join(
        f'<section>\n<h2 id="{anchor}">{escape(section.title)}</h2>\n{section.body}\n</section>\n'
        for anchor, section in zip(anchors, sections, strict=True)
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n{lead}\n<nav><ul>{links}</ul></nav>\n{parts}</body>\n</html>\n"
    )


def heading(text: str) -> str:
    """A heading within a section."""
    return f"<h3>{escape(text)}</h3>\n"


def paragraph(text: str, kind: str = "") -> str:
    """Text as a paragraph; the kind "note" highlights it."""
    return f'<p class="{kind}">{escape(text)}</p>\n' if kind else f"<p>{escape(text)}</p>\n"


def code(text: str) -> str:
    """A command or a listing; long lines are wrapped."""
    return f"<pre><code>{escape(text)}</code></pre>\n"


def listing(entries: Sequence[str]) -> str:
    """Texts as a bulleted list."""
    return "<ul>\n" + "".join(f"<li>{escape(entry)}</li>\n" for entry in entries) + "</ul>\n"


def table(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    caption: str = "",
    text: Sequence[int] = (0,),
    marked: Sequence[int] = (),
    code: Sequence[int] = (),
) -> str:
    """A table.

    Args:
        columns: Column heads; line breaks in them are kept.
        rows: Rows with one cell for each column. Further lines of a cell are shown in small print below it.
        caption: Caption above the table.
        text: Indices of text columns, aligned left; all others hold numbers.
        marked: Indices of highlighted rows.
        code: Indices of columns with commands.
    """
    heads = "".join(f'<th scope="col"{_kind(k in text)}>{escape(name)}</th>' for k, name in enumerate(columns))
    body = "".join(
        ('<tr class="marked">' if number in marked else "<tr>")
        + "".join(f"<td{_kind(k in text)}>{_cell(cell, k in code)}</td>" for k, cell in enumerate(row))
        + "</tr>\n"
        for number, row in enumerate(rows)
    )
    above = f"<caption>{escape(caption)}</caption>\n" if caption else ""
    kind = "scroll whole" if len(rows) <= SHORT else "scroll"
    return (
        f'<div class="{kind}"><table>\n{above}<thead><tr>{heads}</tr></thead>\n<tbody>\n{body}</tbody></table></div>\n'
    )


def _kind(is_text: bool) -> str:
    return ' class="text"' if is_text else ""


def _cell(text: str, is_code: bool) -> str:
    first, *more = text.split("\n")
    told = f"<code>{escape(first)}</code>" if is_code else escape(first)
    return told + "".join(f'<span class="detail">{escape(line)}</span>' for line in more)


def figure(svg: str, caption: str) -> str:
    """An SVG from `plotting.svg_of`, with its caption below. On a narrow screen it scrolls rather than shrinks."""
    return panels([(svg, "")], caption)


def panels(drawn: Sequence[tuple[str, str]], caption: str, keys: str = "", large: int = 0) -> str:
    """Pictures side by side that fill the width: as many in a row as stay legible, one on a narrow screen.

    Args:
        drawn: Each picture as SVG from `plotting.svg_of`, and HTML below it.
        caption: Caption of all, as plain text.
        keys: Legend above, HTML from `legend`.
        large: Number of pictures, from the first, that take two places.
    """
    widths = [_points(svg) for svg, _ in drawn]
    told = escape(caption)
    # Below 0.8 of the drawn size, texts of 8 points are hard to read.
    parts = "".join(
        f'<div class="panel{" large" if k < large else ""}"><div style="min-width:{min(0.8 * width, LEAST):.0f}pt">'
        f"{svg}</div>{below}</div>\n"
        if width <= NARROW
        else f'<div class="panel"><div style="min-width:{0.8 * width:.0f}pt">{svg}</div>{below}</div>\n'
        for k, ((svg, below), width) in enumerate(zip(drawn, widths, strict=True))
    )
    least = 0.85 * min(min(widths, default=NARROW), NARROW)
    return (
        f'<figure role="group" aria-label="{told}">\n{keys}<div class="panels" style="--least:{least:.0f}pt">\n{parts}'
        f"</div>\n<figcaption>{told}</figcaption></figure>\n"
    )


def legend(entries: Sequence[tuple[str, str, str]]) -> str:
    """A legend of lines: name, colour and SVG dash pattern of each."""
    keys = "".join(
        '<span><svg viewBox="0 0 22 8"><line x1="0" y1="4" x2="22" y2="4" stroke-width="3" '
        f'stroke="{colour}" stroke-dasharray="{dashes}"/></svg>{escape(name)}</span>'
        for name, colour, dashes in entries
    )
    return f'<div class="keys">{keys}</div>\n'


def folded(title: str, body: str) -> str:
    """HTML that a click on its title opens."""
    return f"<details><summary>{escape(title)}</summary>\n{body}</details>\n"


def _points(svg: str) -> float:
    """Drawn width of an SVG of matplotlib, points."""
    found = re.search(r'<svg[^>]*? width="([0-9.]+)pt"', svg)
    return float(found[1]) if found else NARROW
