"""`navloom` and `python -m navloom`: the command line."""

from __future__ import annotations

import os
import sys

__all__ = ["main"]

RUNS_PLUGINS = {"check", "map", "plan", "replay", "run"}
"""Commands in whose process plugins run."""


def main() -> None:
    """Entry point. `--version` and `stop` are served before anything heavy is imported."""
    given = sys.argv[1:]
    if given in (["--version"], ["--version", "--json"]):
        from navloom.installed import print_versions

        print_versions("--json" in given)
    # An operator who stops a robot must not wait for the imports of a command line.
    elif given[:1] != ["stop"] or not _stop(given[1:]):
        _run()


def _stop(words: list[str]) -> bool:
    """Stop a robot without loading the command line; False if only the command line can do it."""
    from navloom.parts import has_part, part

    if not has_part("navloom_live"):
        return False
    stopping = part("navloom_live.operating.stop_command")
    options = stopping.read_options(words)
    code = None if options is None else stopping.stop_at_once(options)
    if code:
        sys.exit(code)
    return code is not None


def _run() -> None:
    """Run the command line; when C code crashes it, show the Python lines that it came from."""
    from navloom.crash_watch import watch_over
    from navloom.crashes import dump_when_broken

    if sys.argv[1:2] and sys.argv[1] in RUNS_PLUGINS:
        watch_over("--traceback" in sys.argv or bool(os.environ.get("NAVLOOM_TRACEBACK")))
    else:
        dump_when_broken()
    from navloom.cli import main as run
    from navloom.cli.process_exit import end_in_time

    try:
        run()
    except SystemExit as ended:
        # A thread of a plugin may keep the process from ending.
        end_in_time(ended.code if isinstance(ended.code, int) else int(ended.code is not None))
        raise


if __name__ == "__main__":
    main()
