"""The shipped configs give the streams that were recorded when each last changed on purpose."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from navloom.config import load_config
from navloom.engine.trace import read_trace
from navloom.messages.codec import encode
from navloom.messages.schema import OLDER, in_version
from navloom.runs.episode import Episode, run_episode

FILE = Path(__file__).with_name("recorded_streams.json")
RECORDED: dict[str, dict[str, str]] = json.loads(FILE.read_text())
"""By config, with its own seed: `trace`, the SHA-256 of trace.bin, and the hash of each stream. A stream that changes
belongs in the changelog."""


Streams = dict[str, str]


def streams_of(trace: Path) -> Streams:
    """By stream, "role instance port": the first 16 digits of the SHA-256 of its messages and envelopes.

    A stream whose schema has older versions is there as each of them too: as `gate main status/1`.
    """
    hashes: dict[str, Any] = {}
    for entry in read_trace(trace):
        stream, message = f"{entry.role} {entry.instance} {entry.port}", entry.message
        hashes.setdefault(stream, sha256()).update(encode(message, entry.envelope))
        for label, older in OLDER.items():
            if older.schema_name == message.schema_name:
                version = hashes.setdefault(f"{stream}/{older.schema_version}", sha256())
                version.update(encode(in_version(message, label), entry.envelope))
    return {name: stream.hexdigest()[:16] for name, stream in sorted(hashes.items())}


def run(config: str, folder: Path) -> tuple[Episode, Streams]:
    """A shipped config's run, and what its streams are."""
    with (folder / f"{config}.bin").open("wb") as trace:
        episode = run_episode(load_config(config), trace=trace)
    return episode, {"trace": episode.log.trace_sha256, **streams_of(folder / f"{config}.bin")}


@pytest.mark.skipif(platform.machine() != "x86_64", reason="recorded on x86_64: other processors may round otherwise")
@pytest.mark.parametrize("config", RECORDED)
def test_a_shipped_config_gives_the_recorded_streams(config: str, tmp_path: Path) -> None:
    episode, streams = run(config, tmp_path)
    assert episode.summary()["truly_reached"]
    assert {name for name, _ in streams.items() ^ RECORDED[config].items()} == set()


SHA = """
import sys
from navloom.config import load_config
from navloom.runs.episode import run_episode
print(run_episode(load_config(sys.argv[1])).log.trace_sha256)
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="kernels of x86_64")
@pytest.mark.parametrize("config", RECORDED)
def test_the_trace_does_not_depend_on_the_kernels_that_openblas_chooses_for_the_processor(config: str) -> None:
    """Prescott's kernels have neither AVX nor fused products, which round differently."""
    plain = {**os.environ, "OPENBLAS_CORETYPE": "Prescott"}
    done = subprocess.run([sys.executable, "-c", SHA, config], env=plain, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == RECORDED[config]["trace"]


if __name__ == "__main__":  # after a change on purpose: record what the streams are now
    with tempfile.TemporaryDirectory() as folder:
        now = {config: run(config, Path(folder))[1] for config in RECORDED}
    FILE.write_text(json.dumps(now, indent=1) + "\n")
