"""Whether the docstring and the declaration of a message agree."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

from navloom.messages import Message

from navloom_check.check_bench import Bench
from navloom_check.checked_plugin import place_of
from navloom_check.checks import check
from navloom_check.contract.plugin_declarations import has_unit
from navloom_check.findings import Finding

__all__ = ["CHECKS"]

ENTRY = re.compile(r"^\s*((?:\w+, )*\w+)\s*:\s*(.*)$")
"""A line of a docstring that begins the description of fields: `x, y: (n,) where, m.`"""
SHAPE = re.compile(r"^\(([\w, ]*)\)")
OF_UNIT = re.compile(
    r"\b(where|positions?|places?|cent(?:re|er)s?|corners?|distances?|ranges?|speeds?|velocit(?:y|ies)|headings?|bearings?|"
    r"angles?|directions?|length|width|height|radius|radii|durations?|how (?:far|fast|long|wide|high))\b", re.IGNORECASE
)  # fmt: skip
"""Words for quantities that have a unit."""
STAMPS = re.compile(r"(^|_)(stamp|stamp_ns|time_ns)$")


def _described(cls: type[Message]) -> dict[str, str]:
    """Description of each field in the docstring of a message; fields without one are left out."""
    found: dict[str, str] = {}
    names: list[str] = []
    for line in inspect.cleandoc(cls.__doc__ or "").splitlines():
        entry = ENTRY.match(line)
        if entry is not None and all(name in cls.kinds for name in entry[1].split(", ")):
            names = entry[1].split(", ")
            found.update(dict.fromkeys(names, entry[2]))
        elif line.strip():
            found.update({name: f"{found[name]} {line.strip()}" for name in names})
        else:
            names = []
    return found


@check("contract", {"message"}, "Its docstring gives arrays the declared shape, and lengths, speeds and angles a "
       "unit; its stamps are `Stamp`.", is_static=True)  # fmt: skip
def declared_as_described(bench: Bench) -> Iterator[Finding]:
    """A letter of a shape stands for the same size in all fields; with another letter, sizes may differ."""
    cls: type[Message] = bench.subject.thing
    told = _described(cls)
    for name, kind in cls.kinds.items():
        text = told.get(name, "")
        shape = SHAPE.match(text)
        if kind.array is not None and shape is not None:
            given = tuple(part.strip() for part in shape[1].split(",") if part.strip())
            declared = tuple(map(str, kind.array.shape))
            if given != declared:
                yield Finding(
                    f"declares {name} with the shape ({', '.join(declared)}), and describes it as {shape[0]}",
                    "the same letters for the same sizes in the declaration and in the docstring",
                )  # fmt: skip
                return
        is_real = kind.form == "float" or (kind.array is not None and kind.array.dtype.startswith("float"))
        if is_real and OF_UNIT.search(text) and not has_unit(text):
            yield Finding(f"the docstring of {cls.__name__} gives {name} no unit: {text!r}", "its unit, as in 'where "
                          "it is, m, map frame'; or 'no unit'")  # fmt: skip
            return
        if kind.form in ("float", "int") and STAMPS.search(name) and kind.rule != "stamp":
            yield Finding(f"declares {name} as {kind.form}", f"{name}: Stamp, which is ns of the run clock")
            return


@check("contract", {"message"}, "It has no `__post_init__`, which would never be called.", is_static=True)
def constructor(bench: Bench) -> Iterator[Finding]:
    """The decorator generates the constructor, which checks the declared bounds and copies the arrays."""
    method = vars(bench.subject.thing).get("__post_init__")
    if method is not None:
        yield Finding("defines __post_init__, which is never called", "bounds in the annotations, such as NotNegative "
                      "or Array(…, at_least=0.0); convert where the message is made", place_of(method))  # fmt: skip


CHECKS = (declared_as_described, constructor)
