"""Processor time of a whole `navloom compare`: the command and its workers, imports and the report included.

    python benchmarks/study_cost.py [CONFIG] --vary avoider=dwa --worlds barn:F.npz#1-300 [--seeds 0:10] [--jobs 2]
                                    [--rounds N] [--set A.B=V] [--beside PYTHON] [--json]

Run it with the navloom that is to be measured; `--beside` measures another interpreter's in turn, and the order
alternates from round to round. The rows, tracks and tables of both must be the same bytes, else it ends with 1.
Processor time hardly depends on what else the machine does, as wall time does. Nothing of navloom is imported.
"""

from __future__ import annotations

import hashlib
import json
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from beside import arguments, clean_environment, in_turns, set_options

__all__ = ["main", "result_digest", "study_seconds"]

RESULTS = ("episodes.csv", "summary.csv", "differences.csv", "trails/*")
"""Files of a study that hold results alone, without times or versions."""


def study_seconds(interpreter: str, command: Sequence[str]) -> tuple[float, str]:
    """Processor time of one study, s, its workers' included, and the hash of its results."""
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [interpreter, "-m", "navloom", "compare", *command, "--out", f"{folder}/study"],
            check=True, stdout=subprocess.DEVNULL, env=clean_environment(),
        )  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return spent, result_digest(Path(folder, "study"))


def result_digest(folder: Path) -> str:
    """Hash of the results of a study. Raises FileNotFoundError where there are none."""
    files = sorted(file for pattern in RESULTS for file in folder.glob(pattern))
    if not files:
        raise FileNotFoundError(f"{folder}: no results of a study")
    digest = hashlib.sha256()
    for file in files:
        digest.update(f"{file.relative_to(folder)}\0".encode() + file.read_bytes())
    return digest.hexdigest()


def main(words: Sequence[str] | None = None) -> int:
    """Measure, and print medians; 1 if the results differ."""
    parser = arguments(__doc__)
    parser.add_argument("--vary", action="append", default=[], metavar="PATH=A,B", help="as of `compare`; repeats")
    parser.add_argument("--worlds", action="append", default=[], metavar="REF", help="as of `compare`; repeats")
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--jobs", default="2")
    parser.add_argument("--rounds", type=int, default=2)
    given = parser.parse_args(words)
    pairs = [("--vary", value) for value in given.vary] + [("--worlds", value) for value in given.worlds]
    command = [given.config, "--seeds", given.seeds, "--jobs", given.jobs, *set_options(given.set)]
    command += [word for pair in pairs for word in pair]
    found = in_turns(
        given.beside,
        range(given.rounds),
        lambda interpreter, number: study_seconds(interpreter, command),
        lambda one: f"{one[0]:.1f} s",
    )
    told: dict[str, Any] = {side: statistics.median(spent for spent, _ in rounds) for side, rounds in found.items()}
    told["same_results"] = len({digest for rounds in found.values() for _, digest in rounds}) == 1
    if given.beside:
        told["beside_over_here"] = told["beside"] / told["here"]
    print(json.dumps(told) if given.json else "\n".join(f"{name}: {value}" for name, value in told.items()))
    return int(not told["same_results"])


if __name__ == "__main__":
    sys.exit(main())
