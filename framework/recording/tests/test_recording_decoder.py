"""The decoder of docs/recording.md reads every message without navloom, with only the recording's own schemas."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from navloom.messages import Envelope, Message
from navloom.messages.codec import encode, schema_label
from navloom_recording.json_schemas import schema_text
from navloom_recording.recording_header import RecordingHeader
from navloom_recording.writer import RecordingWriter

TOP = Path(__file__).resolve().parents[3]
WITHOUT = """
import sys

class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0].startswith("navloom"):
            raise ImportError(name)

sys.meta_path.insert(0, Refused())
"""
"""Code that makes `import navloom` fail."""
PRINT = """
def plain(value):
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, list):
        return [plain(one) for one in value]
    return {"dtype": value.dtype.str, "values": value.tolist()} if isinstance(value, np.ndarray) else value

for topic, envelope, fields in messages(sys.argv[1]):
    print(json.dumps([topic, envelope, plain(fields)]))
"""


def _packing() -> ModuleType:
    """The random messages of test_messages_packing.py, which `--import-mode=importlib` does not make importable."""
    path = TOP / "framework" / "core" / "tests" / "messages" / "test_messages_packing.py"
    spec = importlib.util.spec_from_file_location("navloom_test_packing", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


packing = _packing()


def plain(value: Any) -> Any:
    """A message as the child prints it."""
    if isinstance(value, Message):
        return {name: plain(getattr(value, name)) for name in type(value).kinds}
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return {"dtype": value.dtype.str, "values": value.tolist()} if isinstance(value, np.ndarray) else value


def test_the_decoder_of_the_docs_reads_every_class_without_navloom(tmp_path: Path) -> None:
    path, random = tmp_path / "run.mcap", np.random.default_rng(5)
    expected = []
    with RecordingWriter(path, RecordingHeader("lab", "r1", "live", 0.05, 7, "wall"), {}) as writer:
        for number, cls in enumerate(packing.CLASSES * 4):
            key = f"lab/r1/role/main/{cls.__name__.lower()}"
            message, at = packing.message(cls, random), Envelope(key, number + 1, number, number * 10, number * 9, 0)
            writer.add(key, schema_label(cls), encode(message, at), number, at.stamp_ns, at.sequence)
            expected.append([key, at._asdict(), plain(message)])
        writer.close({"messages": len(expected)})
    page = (TOP / "docs" / "recording.md").read_text("utf-8")
    found = re.search(r"<!-- decoder -->\n```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert found is not None
    decoder = found[1].partition("\n\nfor topic, envelope")[0]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT + decoder + PRINT, str(path)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert len(expected) > 150
    for line, wanted in zip(done.stdout.splitlines(), expected, strict=True):
        assert json.loads(line) == json.loads(json.dumps(wanted))


@pytest.mark.parametrize("cls", packing.CLASSES, ids=lambda cls: cls.__name__)
def test_a_header_fits_its_schema(cls: type[Message]) -> None:
    schema = json.loads(schema_text(cls))
    fields = schema["$defs"][cls.schema_name]
    assert list(fields["properties"]) == list(cls.kinds) and schema["title"] == schema_label(cls)
    arrays = {name for name, kind in cls.kinds.items() if kind.array is not None}
    described = {name: part["anyOf"][0] if "anyOf" in part else part for name, part in fields["properties"].items()}
    assert {name for name, part in described.items() if "array" in part} == arrays
    for name in arrays:
        array = cls.kinds[name].array
        assert array is not None
        assert described[name]["array"]["dtype"] == np.dtype(array.dtype).str
        assert described[name]["array"]["shape"] == list(array.shape)
