"""The tables of parameters and presets in the plugins' READMEs: `python tests/preset_tables.py` writes them again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from navloom.plugins import Discovery
from navloom.roles import ROLES, Role

PLUGINS = Path(__file__).parents[1] / "plugins"
BEGIN, END = "<!-- parameters -->\n", "<!-- end of parameters -->\n"


def plugins_with_presets(discovery: Discovery) -> dict[str, list[type[Role]]]:
    """Classes with presets, by the folder of their distribution."""
    found: dict[str, list[type[Role]]] = {}
    for info in discovery.infos():
        folder = info.distribution.removeprefix("navloom-").replace("-", "_")
        if info.role in ROLES and (PLUGINS / folder).is_dir():
            cls = discovery.role(info.role, info.name)
            if cls.presets:
                found.setdefault(folder, []).append(cls)
    return found


def tables(classes: Sequence[type[Role]]) -> str:
    """The section: every parameter with its defaults, then each preset's values beside them."""
    keys = list(dict.fromkeys(key for cls in classes for key in cls.Params.model_fields))
    head = ["key", *(cls.name if len(classes) > 1 else "robust" for cls in classes), "meaning and unit"]
    rows = [[f"`{key}`", *(_default(cls, key) for cls in classes), _meaning(classes, key)] for key in keys]
    lines = [*_table(head, rows), ""]
    for cls in classes:
        for name, preset in cls.presets.items():
            if not preset.settings:
                continue
            lines += [f"`{cls.name}@{name}` follows {preset.about}:", ""]
            rows = [
                [f"`{key}`", _shown(value), _default(cls, key), why] for key, (value, why) in preset.settings.items()
            ]
            lines += [*_table(["key", name, "robust", "where it stands, or why it was decided"], rows), ""]
    return "\n".join(lines)


def section(readme: str) -> tuple[str, str, str]:
    """A README before, in and after its section."""
    before, found, rest = readme.partition(BEGIN)
    inside, ended, after = rest.partition(END)
    if not found or not ended:
        raise ValueError(f"expected the lines {BEGIN.strip()} and {END.strip()}")
    return before, inside, after


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"


def _default(cls: type[Role], key: str) -> str:
    field = cls.Params.model_fields.get(key)
    return "" if field is None else _shown(field.default)


def _meaning(classes: Sequence[type[Role]], key: str) -> str:
    texts = dict.fromkeys(str(cls.Params.model_fields[key].description) for cls in classes
                          if key in cls.Params.model_fields)  # fmt: skip
    return " ".join(texts)


def _shown(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def main() -> None:
    """Write the section of every README again."""
    for folder, classes in plugins_with_presets(Discovery()).items():
        path = PLUGINS / folder / "README.md"
        before, _, after = section(path.read_text("utf-8"))
        path.write_text(f"{before}{BEGIN}\n{tables(classes)}{END}{after}", "utf-8")


if __name__ == "__main__":
    main()
