"""Draw architecture.svg: the nodes in the order of a tick, and the streams between them, from the code's own tables.

Run: python docs/pictures/architecture.py
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.node_graph import edges
from navloom.engine.node_ports import NodeSpec
from navloom.roles import ROLES, answers_of, verb_of

TARGET = Path(__file__).with_name("architecture.svg")
CONFIG = "building"
"""A config with a laser, whose nodes and streams are drawn."""
WIDTH, LEFT, RIGHT, TOP, ROW, BOX = 400, 104, 280, 52, 62, 42
"""Of the picture and of a box, px: x of its edges, y of the first, from one to the next, height."""
BLUE, GREEN, ORANGE, GREY = "#0072b2", "#007a58", "#b34700", "#444444"


class Rail(NamedTuple):
    """A stream that several nodes read, drawn as a vertical line.

    Attributes:
        name: Above the line, at height `name_y`, px.
        x: Its place, px.
        colour: Of line and name.
        tap: Height at which readers are joined to it, from the middle of their box, px; publishers are 8 px lower.
        streams: (role, port) that it stands for; a role's port `*` is any sensor.
        to: The only node it leads to; empty for every reader.
    """

    name: str
    name_y: int
    x: int
    colour: str
    tap: int
    streams: tuple[tuple[str, str], ...]
    to: str = ""


DRIVERS = ("operator", "controller", "avoider", "recovery")
"""Whose velocities the gate chooses from."""
RAILS = (
    Rail("scans", 28, 30, BLUE, -10, (("platform", "*"),)),
    Rail("map", 28, 74, GREEN, 0, (("mapper", "map"), ("mapper", "known"))),
    Rail("pose", 28, 304, BLUE, -10, (("localizer", "pose"),)),
    Rail("velocity", 44, 346, ORANGE, 0, tuple((role, "command") for role in DRIVERS), "gate"),
    Rail("wheels", 28, 376, GREY, 4, (("gate", "command"),), "platform"),
)  # fmt: skip


def picture() -> str:
    """The whole file."""
    specs = assemble(load_config(CONFIG)).specs
    ordered = [spec for spec in specs if spec.role != "operator"]
    at = next(number for number, spec in enumerate(ordered) if spec.role == "goal")
    ordered.insert(at, next(spec for spec in specs if spec.role == "operator"))  # above the node that it asks
    rows = {spec.role: TOP + ROW * number for number, spec in enumerate(ordered)}
    wires = [(source, reader, given.port) for source, reader, given in edges(specs)]
    height = TOP + ROW * len(ordered) + 40
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif">',
        "<title>The nodes of navloom in the order of a tick, and the streams between them</title>",
        f'<rect width="{WIDTH}" height="{height}" rx="8" fill="#ffffff"/>',
        *(part for rail in RAILS for part in rail_parts(rail, wires, rows)),
        *chain(ordered, wires, rows),
        *(part for spec in ordered for part in box(spec, rows[spec.role])),
        *legend(height - 26),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def is_on(rail: Rail, source: str, port: str) -> bool:
    """Whether a rail stands for a stream; every port of the platform that carries a sensor's data is a scan."""
    return (source, port) in rail.streams or (
        (source, "*") in rail.streams and port not in {"odometry", "contact", "truth"}
    )


def rail_parts(rail: Rail, wires: Iterable[tuple[str, str, str]], rows: dict[str, int]) -> list[str]:
    """A rail with its name, a line from each publisher and an arrow to each reader."""
    on = [(source, reader) for source, reader, port in wires if is_on(rail, source, port)]
    sources = {source for source, reader in on if rail.to in ("", reader)}
    readers = {reader for _, reader in on if rail.to in ("", reader)} - sources
    middle = {role: rows[role] + BOX // 2 + rail.tap for role in sources | readers}
    ends = [middle[role] + 8 for role in sources] + [middle[role] for role in readers]
    edge = LEFT if rail.x < LEFT else RIGHT
    lines = [
        f'<text x="{rail.x}" y="{rail.name_y}" font-size="13" text-anchor="middle" fill="{rail.colour}">'
        f"{rail.name}</text>",
        f'<path d="M{rail.x} {min(ends)}V{max(ends)}" stroke="{rail.colour}" stroke-width="3"/>',
    ]
    lines += [
        f'<path d="M{edge} {middle[role] + 8}H{rail.x}" stroke="{rail.colour}" stroke-width="3"/>'
        f'<circle cx="{rail.x}" cy="{middle[role] + 8}" r="4" fill="{rail.colour}"/>'
        for role in sorted(sources)
    ]
    return lines + [arrow(rail.x, edge, middle[role], rail.colour) for role in sorted(readers)]


def arrow(start: int, edge: int, y: int, colour: str) -> str:
    """A level line from a rail to the edge of a box."""
    back = -8 if edge > start else 8
    return (
        f'<path d="M{start} {y}H{edge + back}" stroke="{colour}" stroke-width="1.6"/>'
        f'<path d="M{edge} {y}l{back} -4v8z" fill="{colour}"/>'
    )


def chain(ordered: list[NodeSpec], wires: list[tuple[str, str, str]], rows: dict[str, int]) -> list[str]:
    """An arrow between each two nodes that follow each other, with the stream that leads from the one to the other."""
    found: list[str] = []
    x = (LEFT + RIGHT) // 2
    for above, below in pairwise(ordered):
        names = [port for source, reader, port in wires if (source, reader) == (above.role, below.role)]
        if names:
            start, end = rows[above.role] + BOX, rows[below.role]
            found += [
                f'<path d="M{x} {start}V{end - 6}" stroke="#222222" stroke-width="1.6"/>',
                f'<path d="M{x} {end}l-4 -8h8z" fill="#222222"/>',
                f'<text x="{x + 8}" y="{end - 5}" font-size="12" fill="#222222">{names[0]}</text>',
            ]
    return found


def box(spec: NodeSpec, y: int) -> list[str]:
    """A node: its role, and what its plugin is asked and answers."""
    is_plugin = spec.role in ROLES
    fill, stroke = ("#e6f2fa", BLUE) if is_plugin else ("#f2f2f2", "#777777")
    middle = (LEFT + RIGHT) // 2
    what = f"{verb_of(spec.role)}: {answers_of(spec.role)[0].__name__}" if is_plugin else "part of navloom"
    return [
        f'<rect x="{LEFT}" y="{y}" width="{RIGHT - LEFT}" height="{BOX}" rx="5" fill="{fill}" stroke="{stroke}"/>',
        f'<text x="{middle}" y="{y + 18}" font-size="15" font-weight="bold" text-anchor="middle">{spec.role}</text>',
        f'<text x="{middle}" y="{y + 34}" font-size="12" text-anchor="middle" fill="#333333">{what}</text>',
    ]


def legend(y: int) -> list[str]:
    """What the fills mean."""
    return [
        f'<rect x="20" y="{y}" width="14" height="14" fill="#e6f2fa" stroke="{BLUE}"/>',
        f'<text x="40" y="{y + 12}" font-size="13">plugin: its verb and answer</text>',
        f'<rect x="236" y="{y}" width="14" height="14" fill="#f2f2f2" stroke="#777777"/>',
        f'<text x="256" y="{y + 12}" font-size="13">part of navloom</text>',
    ]


if __name__ == "__main__":
    TARGET.write_text(picture(), "utf-8")
