"""Parses untrusted TOML, JSON and YAML: nesting is bounded before parsing, and every fault becomes one error."""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

from navloom.inputs.bounds import DEEPEST, Refusal

__all__ = [
    "INSTANCE", "TOML_TOKENS", "first_words", "json_of", "refuse_deep_toml", "refuse_deep_tree",
    "shortened", "toml_of",
]  # fmt: skip

INSTANCE = r"^[A-Za-z0-9_-]+(@[A-Za-z0-9_-]+)?$"
"""Pattern of names of instances: that of a plugin with a preset is `vfh@printed`."""
TOML_TOKENS = re.compile(
    r'"""[^"\\]*+(?:(?:\\.|"(?!""))[^"\\]*+)*+"""'
    r"|'''[^']*+(?:'(?!'')[^']*+)*+'''"
    r'|"[^"\\\n]*+(?:\\.[^"\\\n]*+)*+"'
    r"|'[^'\n]*+'"
    r"|\#[^\n]*+"
    r"|[\[\]{}.=,\n]",
    re.DOTALL,
)
"""Tokens of nesting in TOML; strings and comments, which do not nest, are one match each."""
_JSON = re.compile(r'"[^"\\]*+(?:\\.[^"\\]*+)*+"|[\[\]{}]', re.DOTALL)


def toml_of(text: str, where: str, refusal: Refusal) -> dict[str, Any]:
    """A TOML document.

    Args:
        text: The document.
        where: Name of the document in errors.
        refusal: Makes the error for a document that cannot be parsed or is nested too deeply.
    """
    refuse_deep_toml(text, where, refusal)
    try:
        tree = tomllib.loads(text)
    except ValueError as error:
        raise refusal(f"{where}: not TOML: {first_words(error)}") from None
    # Dotted keys within brackets add up, and only the result shows it.
    refuse_deep_tree(tree, where, refusal)
    return tree


def refuse_deep_toml(text: str, where: str, refusal: Refusal) -> None:
    """Refuse deep brackets and dotted keys, on which the parser recurses or takes quadratic time."""
    depth = dots = 0
    for match in TOML_TOKENS.finditer(text):
        token = match[0]
        if token in ("[", "{"):
            depth, dots = depth + 1, 0
        elif token in ("]", "}"):
            depth -= 1
        elif token == ".":
            dots += 1
        elif token in ("=", ",", "\n"):
            dots = 0
        if depth > DEEPEST or dots >= DEEPEST:
            line = text.count("\n", 0, match.start()) + 1
            what = f"more than {DEEPEST} brackets deep" if depth > DEEPEST else f"a key of more than {DEEPEST} parts"
            raise refusal(f"{where}: line {line}: {what}, expected at most {DEEPEST}")


def json_of(content: str | bytes, where: str, refusal: Refusal) -> Any:
    """A JSON document; for the arguments see `toml_of`."""
    try:
        text = content if isinstance(content, str) else content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise refusal(f"{where}: not JSON: {first_words(error)}") from None
    depth = 0
    for match in _JSON.finditer(text):
        token = match[0]
        depth += 1 if token in ("[", "{") else -1 if token in ("]", "}") else 0
        if depth > DEEPEST:
            raise refusal(f"{where}: more than {DEEPEST} brackets deep, expected at most {DEEPEST}")
    try:
        return json.loads(text)
    except ValueError as error:  # also raised for integers of more than 4300 digits
        raise refusal(f"{where}: not JSON: {first_words(error)}") from None


def shortened(given: object, most: int = 60) -> str:
    """A value's repr, cut to a length, for error texts."""
    text = repr(given[: most + 1] if isinstance(given, str | bytes) else given)
    return text if len(text) <= most else f"{text[: most - 3]}..."


def refuse_deep_tree(tree: Any, where: str, refusal: Refusal) -> None:
    """Refuse tables that are too deep in total, though each bracket and dotted key is within its bound."""
    level: list[Any] = [[tree]]
    for _ in range(DEEPEST + 1):
        level = [
            inner
            for outer in level
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, dict | list)
        ]
        if not level:
            return
    raise refusal(f"{where}: tables more than {DEEPEST} deep, expected at most {DEEPEST}")


def first_words(error: Exception) -> str:
    """A parser's message in one line, cut to 200 characters."""
    text = str(error).strip().replace("\n", " ") or type(error).__name__
    return text if len(text) <= 200 else f"{text[:197]}..."
