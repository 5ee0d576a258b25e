"""Untrusted files: size bounds of each kind, and readers that keep them.

Begin with `bounds.py`: every file from outside is opened through it. `texts.py` parses TOML, JSON and YAML,
`npz.py` arrays and `assignments.py` the `key = value` of options and requests.
Nesting and sizes are checked before anything is parsed or allocated; each fault becomes one error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from navloom.parts import lazy_names

if TYPE_CHECKING:
    from navloom.escapes import printable as printable
    from navloom.inputs.bounds import ARRAYS_MB as ARRAYS_MB
    from navloom.inputs.bounds import BAG_MB as BAG_MB
    from navloom.inputs.bounds import DEEPEST as DEEPEST
    from navloom.inputs.bounds import IMAGE_MB as IMAGE_MB
    from navloom.inputs.bounds import LOG_MB as LOG_MB
    from navloom.inputs.bounds import TEXT_MB as TEXT_MB
    from navloom.inputs.bounds import YAML_MB as YAML_MB
    from navloom.inputs.bounds import Refusal as Refusal
    from navloom.inputs.bounds import bytes_of as bytes_of
    from navloom.inputs.bounds import open_file as open_file
    from navloom.inputs.bounds import read_file as read_file
    from navloom.inputs.bounds import read_past as read_past
    from navloom.inputs.bounds import too_large as too_large
    from navloom.inputs.headings import heading_problem as heading_problem
    from navloom.inputs.headings import warn_of_radians as warn_of_radians
    from navloom.inputs.npz import Arrays as Arrays
    from navloom.inputs.texts import first_words as first_words
    from navloom.inputs.texts import json_of as json_of
    from navloom.inputs.texts import shortened as shortened
    from navloom.inputs.texts import toml_of as toml_of
else:
    __all__, __getattr__ = lazy_names(
        "navloom.inputs",
        {
            "navloom.escapes": "printable",
            "navloom.inputs.bounds": (
                "ARRAYS_MB BAG_MB DEEPEST IMAGE_MB LOG_MB TEXT_MB YAML_MB Refusal bytes_of open_file read_file "
                "read_past too_large"
            ),
            "navloom.inputs.headings": "heading_problem warn_of_radians",
            "navloom.inputs.npz": "Arrays",
            "navloom.inputs.texts": "first_words json_of shortened toml_of",
        },
    )
