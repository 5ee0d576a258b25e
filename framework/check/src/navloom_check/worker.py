"""The process of a plugin: loads it, runs the checks, and reports each as a line of JSON.

`python -m navloom_check.worker`, started by `navloom_check.runner`. Standard input has the job. What the plugin
prints goes to a file, for the check `silent`. The lines are:

- `{"loaded": {owner, place, folder}}` once the plugin is loaded;
- `{"start": NAME}` before a check, `{"result": {…}}` after it; `{"done": true}` at the end.

If the process ends without the last line, the runner blames the plugin: the file `mark` names the call under way, and
the file `crash` its line, if faulthandler could still write it.
"""

from __future__ import annotations

import gc
import json
import mmap
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

from navloom.errors import NavloomError
from navloom.messages import MessageError
from navloom.messages.codec import CodecError
from navloom.parent_process import die_with_parent
from navloom.parts import MissingPartError

from navloom_check.captured_output import PRINTED
from navloom_check.check_bench import CLOCK, OTHER_CLOCK, OTHER_SEEDS, Bench
from navloom_check.check_scenes import made_scenes
from navloom_check.checked_plugin import CheckRequest, Subject, find
from navloom_check.checks import Check
from navloom_check.findings import Finding, NotRun, Remark, Result
from navloom_check.plugin_player import Fault
from navloom_check.process_state import PROCESS_STATE
from navloom_check.side_effects import GUARD
from navloom_check.worker_process import MARK_SIZE

__all__ = ["main"]

CALL_LIMIT = 20.0
"""Longest call of a plugin, s; the first one may compile."""
WARM_UP_LIMIT = 180.0
"""Longest warm-up, s."""

Tell = Callable[[dict[str, Any]], None]


def main() -> None:
    """Do the job that standard input describes."""
    job = json.loads(sys.stdin.read())
    die_with_parent(job["parent"], signal.SIGKILL)
    out = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    PRINTED.capture()
    with open(job["mark"], "r+b") as file:
        mark = mmap.mmap(file.fileno(), MARK_SIZE)
    GUARD.mark = lambda text: mark.__setitem__(slice(None), text.encode()[:MARK_SIZE].ljust(MARK_SIZE))
    GUARD.install(open(job["crash"], "w", buffering=1))  # noqa: SIM115  (open as long as the process)
    GUARD.limit = job.get("limit") or CALL_LIMIT

    def tell(line: dict[str, Any]) -> None:
        out.write(json.dumps(line) + "\n")
        out.flush()

    request = CheckRequest(job["name"], tuple(job["params"]), job["seed"])
    subject = _loaded(request, job["checks"], tell)
    if subject is not None:
        gc.freeze()  # the collector need not look through the modules again in each of its runs
        bench = Bench(subject, request, Path(job["out"]) if job["out"] else None)
        if job["checks"]:
            _run_checks(bench, job["checks"], tell)
        else:
            tell({"digests": _digests(bench, job["steps"], bool(job["alike"]))})
    tell({"done": True})
    os._exit(0)  # threads that a plugin left must not keep this process alive


def _loaded(request: CheckRequest, checks: Iterable[str], tell: Tell) -> Subject | None:
    """Load the plugin; if that fails, report it as a finding of the check `registers`."""
    started, missing = perf_counter(), ""
    try:
        PROCESS_STATE.note_before_import()
        with GUARD.importing():
            subject = find(request)
        PROCESS_STATE.note_import()
        GUARD.is_own = subject.is_own
        tell({"loaded": {"owner": subject.owner, "place": subject.place, "folder": subject.folder}})
        if hasattr(subject.thing, "warm_up"):
            with GUARD.within("warm_up", WARM_UP_LIMIT):
                subject.thing.warm_up()
        return subject
    except (MessageError, CodecError) as error:
        text, place = f"warm_up() raises {type(error).__name__}: {error}", subject.place
    except NavloomError as error:
        text, place = str(error), ""
        missing = _missing_part(error)
    except (Exception, SystemExit) as error:
        text, place = f"warm_up() raises {type(error).__name__}: {error}", subject.place
    for found in _found(checks):
        name = found.name
        if missing:
            result = Result(name, found.tier, "not_run", reason=missing)
        elif name == "registers":
            finding = Finding(text, "a plugin that can be loaded", place)
            result = Result(name, found.tier, "failed", (finding,), seconds=perf_counter() - started)
        else:
            result = Result(name, found.tier, "not_run", reason="it could not be loaded: see the check `registers`")
        tell({"result": result.to_json()})
    return None


def _missing_part(error: BaseException | None) -> str:
    """Which part of the framework a plugin cannot be imported without, and how it is installed; empty for none."""
    while error is not None:
        if isinstance(error, MissingPartError):
            return str(error)
        error = error.__cause__ or error.__context__
    return ""


def _found(names: Iterable[str]) -> list[Check]:
    # Here, since a process that only compares answers needs no check.
    from navloom_check.tiers import find_check

    return [check for name in names if (check := find_check(name))]


def _run_checks(bench: Bench, names: Iterable[str], tell: Tell) -> None:
    for check in _found(names):
        tell({"start": check.name})
        tell({"result": _run(bench, check).to_json()})


def _run(bench: Bench, check: Check) -> Result:
    """Run one check. An error of the check itself is reported as such, never as the plugin's."""
    started = perf_counter()
    findings: list[Finding] = []
    shown: list[Remark] = []
    reason = ""
    try:
        if not check.is_static and (wrong := _untouchable(bench.subject)):
            raise NotRun(wrong)
        for one in check.run(bench):
            if isinstance(one, Finding):
                findings.append(one)
            else:
                shown.append(one)
    except (NotRun, MissingPartError) as error:
        reason = str(error)
    except Fault as fault:
        findings.append(bench.finding(fault, f"in the check {check.name}"))
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        reason = (
            f"the check itself failed, please report it: {type(error).__name__}: {error} ({place.name}:{place.lineno})"
        )
    outcome: Any = "failed" if findings else "not_run" if reason else "shown" if shown else "passed"
    return Result(check.name, check.tier, outcome, tuple(findings), tuple(shown), reason, perf_counter() - started)


def _untouchable(subject: Subject) -> str:
    """Why no object of a plugin may be made: it opens ports of hardware or talks to outside systems; else empty."""
    if subject.kind == "platform" and not subject.thing.is_simulated:
        return "it is a real platform, which a check would move"
    if getattr(subject.thing, "is_bridge", False):
        return "it is a bridge to a system outside the robot, without which it has no answers"
    return ""


def _digests(bench: Bench, steps: dict[str, int], is_alike: bool) -> dict[str, list[str]]:
    """Hashes of the first answers to some scenes, from the first plays of this process.

    Scenes are played in reverse order, so that state which one leaves in the process affects other scenes than before.
    """
    found = {}
    seeds, clock = (1, CLOCK) if is_alike else (OTHER_SEEDS, OTHER_CLOCK)
    for scene in reversed(made_scenes(bench.subject, bench.seed)):
        if scene.name in steps:
            cut = replace(scene, inputs=scene.inputs[: steps[scene.name]])
            with suppress(Fault):
                answers = bench.play(cut, seeds=seeds, clock=clock)
                found[scene.name] = [answer.hex() for answer in answers]
    return found


if __name__ == "__main__":
    main()
