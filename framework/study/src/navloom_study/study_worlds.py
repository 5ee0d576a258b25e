"""The worlds of a study with their tasks, and its seeds."""

from __future__ import annotations

import hashlib
import math
import re
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import Field, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from navloom.config import ConfigError, Loaded
from navloom.config.config_members import seed_of_member
from navloom.engine.platform_world import own_world
from navloom.geometry.world import World
from navloom.parts import part
from navloom.plugins import Discovery, PluginError

__all__ = [
    "OWN_WORLD",
    "CachedDiscovery",
    "PlacedConfig",
    "WorldCase",
    "expanded",
    "placed",
    "seeds_of",
    "world_digest",
    "worlds_of",
]

OWN_WORLD = "own"
"""Name of the world in a study whose config names none, because the platform provides it."""
LARGEST = 100_000
"""Most worlds or seeds of one range; more is a typing error."""
KEPT = 64
"""Number of parsed worlds that are cached: more than are in use at a time."""
RANGE = re.compile(r"(?P<head>[^:]+:(?:.*#)?)(?P<first>\d{1,9})-(?P<last>\d{1,9})(?P<options>[@?].*)?")


_LATER_FIELDS = {"reference_length", "is_mapped", "material", "actors", "tasks"}
"""Fields of worlds and obstacles that are younger than the first studies."""


class CachedDiscovery(Discovery):
    """Plugins with a cache of the last used worlds, since reading a world takes longer than many ticks."""

    def __init__(self, blocked: Sequence[str] = ()) -> None:
        super().__init__(blocked)
        self._worlds: OrderedDict[tuple[str, str], World] = OrderedDict()

    def world(self, reference: str, base: Path) -> World:
        """Like `Discovery.world`, but returns the same object for the same reference."""
        key = (reference, str(base))
        if key not in self._worlds:
            self._worlds[key] = super().world(reference, base)
            if len(self._worlds) > KEPT:
                self._worlds.popitem(last=False)
        self._worlds.move_to_end(key)
        return self._worlds[key]


@dataclass(frozen=True)
class WorldCase:
    """One world of a study.

    Attributes:
        ref: The world's reference, as in the table.
        values: Its changes of every method's config, by dotted place of two keys.
        sha256: Hash of its contents, so that a changed file is noticed.
    """

    ref: str
    values: dict[str, Any]
    sha256: str


@dataclass(frozen=True)
class PlacedConfig(Loaded):
    """A config with an explicit base folder for references that are not from a file."""

    here: Path = Path()

    def error(self, *problems: str) -> ConfigError:
        """An error with one line for each problem, without a file name: a world's values are not in a file."""
        return ConfigError(*problems)

    def base_of(self, place: str) -> Path:
        """Base folder of the relative paths of a value."""
        return self.here if self.sources.get(place) == "--set" else super().base_of(place)


def placed(given: dict[str, Any], values: dict[str, Any], seed: int, here: Path) -> PlacedConfig:
    """A method's config in one world with one seed.

    Args:
        given: The config, from `Loaded.to_json`.
        values: The world's changes, by dotted place of two keys.
        seed: Seed of every random stream; that of a member follows from it.
        here: Base folder of references that are not from a file.
    """
    tree, member = dict(given["config"]), given.get("member", "")
    own = seed_of_member(seed, member) if member else seed
    for place, value in {**values, "run.seed": own}.items():
        table, key = place.split(".")
        tree[table] = {**tree.get(table, {}), key: value}
    sources = {**given["sources"], **dict.fromkeys(values, "--set")}
    loaded = Loaded.from_json({**given, "config": tree, "sources": sources})
    return PlacedConfig(**vars(loaded), here=here)


def worlds_of(
    base: Loaded, references: Sequence[str], discovery: Discovery, here: Path | None = None
) -> list[WorldCase]:
    """The worlds of a study, default the config's own world, or that of its platform.

    Start, goal and tolerance come from the world if it names them, since those of the config belong to the config's
    own world. A `--set` of them overrides both. Files that a reference names are relative to the folder `here`,
    default the current one.

    Raises:
        ConfigError: A world is repeated or cannot be made; the text names the nearest fix.
    """
    own = base.config.world.ref if base.config.world is not None else None
    if not references and own is None:
        return [_of_platform(base, discovery)]
    here = here or Path.cwd()
    refs = [ref for given in references for ref in expanded(given, here)]
    for ref in refs:
        if refs.count(ref) > 1:
            raise ConfigError(f"--worlds {ref}: is there twice, expected different worlds")
    cases = []
    for ref in refs or [""]:
        folder = here if ref else base.base_of("world.ref")
        try:
            world = discovery.world(ref or own or "", folder)
        except (PluginError, ValueError) as error:
            raise ConfigError(f"{'--worlds' if ref else 'world.ref'}: {error}") from None
        values = {} if not ref else {"world.ref": ref}
        if ref not in ("", own):
            values |= _task(base, world)
        cases.append(WorldCase(ref or own or "", values, world_digest(world)))
    return cases


def _of_platform(base: Loaded, discovery: Discovery) -> WorldCase:
    """The platform's own world; the unknown world of a real robot counts as a case too."""
    world = own_world(base, discovery)
    return WorldCase(OWN_WORLD, {}, "" if world is None else world_digest(world))


def _task(base: Loaded, world: World) -> dict[str, Any]:
    """The task that the world defines, except for values set by hand."""
    by_hand = {".".join(place.split(".")[:2]) for place, source in base.sources.items() if source == "--set"}
    values: dict[str, Any] = {}
    # The members of a fleet keep their own, or take those of the world's tasks.
    if world.start is not None and not base.member:
        own = {"x": world.start.x, "y": world.start.y, "heading_deg": math.degrees(world.start.heading)}
        told, table = base.config.navigation.start, base.config.world
        if told != "unknown":
            # A guess stays one, at the start of the other world.
            spread = (
                {} if told is None else told.model_dump(include={"spread", "heading_spread_deg"}, exclude_none=True)
            )
            values["navigation.start"] = own | spread
        if table is not None and table.start is not None:
            values["world.start"] = own
    if world.goal is not None and not base.member:
        values["navigation.goal"] = {"x": world.goal.x, "y": world.goal.y}
        if base.config.navigation.via:
            values["navigation.via"] = []
        if world.goal_tolerance is not None:
            values["navigation.goal_tolerance"] = world.goal_tolerance
    if world.time_limit is not None:
        values["run.stop_after"] = min(base.config.run.stop_after, world.time_limit)
    return {place: value for place, value in values.items() if place not in by_hand}


def expanded(reference: str, here: Path | None = None) -> list[str]:
    """The references of a range, `scheme:0-49` or `scheme:FILE#1-50`, both ends included; other references unchanged.

    Options after the range, as `scheme:0-49?key=value`, are those of each of its worlds.
    For a BARN file, only the worlds of the range that the file contains are taken.

    Raises:
        ConfigError: The range is empty or too long.
    """
    match = RANGE.fullmatch(reference)
    if match is None:
        return [reference]
    first, last = int(match["first"]), int(match["last"])
    if not 0 <= last - first < LARGEST:
        raise ConfigError(f"--worlds {reference}: expected FIRST-LAST, rising, at most {LARGEST} worlds")
    numbers: Sequence[int] = range(first, last + 1)
    if match["head"].startswith(("barn:", "dynabarn:")):
        numbers = _there(match["head"], numbers, here or Path.cwd())
        if not numbers:
            raise ConfigError(f"--worlds {reference}: the file has no world of these numbers")
    return [f"{match['head']}{number}{match['options'] or ''}" for number in numbers]


def _there(head: str, numbers: Sequence[int], here: Path) -> list[int]:
    scheme, _, file = head.removesuffix("#").partition(":")
    held = set(getattr(part(f"navloom_maps.{scheme}", head), f"{scheme}_numbers")(file, here))
    return [number for number in numbers if number in held]


def seeds_of(text: str) -> list[int]:
    """The seeds of `0:10` (0 to 9), `4`, or several of these with commas.

    Raises:
        ConfigError: Not numbers, none, too many, or a duplicate.
    """
    seeds: list[int] = []
    for piece in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,18})(?::(\d{1,18}))?\s*", piece)
        if match is None:
            raise ConfigError(f"--seeds {text}: expected FIRST:END or a list, as in --seeds 0:10 for 0 to 9, or 3,5,8")
        first = int(match[1])
        end = first + 1 if match[2] is None else int(match[2])
        if not 0 < end - first <= LARGEST:
            raise ConfigError(
                f"--seeds {text}: FIRST:END needs END > FIRST and at most {LARGEST} seeds; END itself is not included"
            )
        seeds += range(first, end)
    if len(set(seeds)) != len(seeds):
        raise ConfigError(f"--seeds {text}: a seed is given twice; give each seed once")
    return seeds


def world_digest(world: World) -> str:
    """Hash of a world's every number and name."""
    digest = hashlib.sha256()
    for piece in _pieces(world):
        digest.update(piece + b"\0")
    return digest.hexdigest()


def _pieces(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape}".encode()
        yield value.tobytes()
    elif is_dataclass(value):
        yield type(value).__name__.encode()
        for entry in fields(value):
            if not _is_unhashed(value, entry):
                yield from _pieces(getattr(value, entry.name))
    elif isinstance(value, tuple):
        yield str(len(value)).encode()
        for inner in value:
            yield from _pieces(inner)
    else:
        yield repr(value).encode()


def _is_unhashed(value: Any, entry: Field[Any]) -> bool:
    """Whether a field is not hashed: a world's name, and defaults of later fields, so that older hashes stay valid."""
    if isinstance(value, World) and entry.name == "name":
        return True
    return entry.name in _LATER_FIELDS and getattr(value, entry.name) == entry.default
