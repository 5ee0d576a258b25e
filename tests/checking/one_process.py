"""Runs one check on each of many plugins in one process: standard input has [plugin, check] pairs as JSON.

Each result is a line of JSON: the plugin, and the result as `navloom check` has it.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile

from navloom_check import worker
from navloom_check.captured_output import PRINTED
from navloom_check.check_bench import Bench
from navloom_check.checked_plugin import CheckRequest
from navloom_check.side_effects import GUARD
from navloom_check.tiers import find_check


def main() -> None:
    """Run the checks that standard input lists."""
    pairs = json.loads(sys.stdin.read())
    out = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    PRINTED.capture()
    errors = tempfile.TemporaryFile()  # noqa: SIM115  (a file, as in the process of `navloom check`)
    os.dup2(errors.fileno(), 2)
    GUARD.install(open(os.devnull, "w"))  # noqa: SIM115  (open as long as the process)
    for name, check in pairs:
        told: list[dict[str, object]] = []
        request = CheckRequest(name)
        subject = worker._loaded(request, [check], told.append)
        if subject is not None:
            found = find_check(check)
            assert found is not None
            told.append({"result": worker._run(Bench(subject, request), found).to_json()})
        place = next((one["loaded"]["place"] for one in told if "loaded" in one), "")  # type: ignore[index]
        out.write(json.dumps({"plugin": name, "place": place, **told[-1]}) + "\n")
    out.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
