"""`navloom` and `python -m navloom`: the command line."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Entry point. A shell that completes a word, and `--version`, are answered before anything heavy is imported."""
    given = sys.argv[1:]
    if given[:1] == ["__complete"]:
        from navloom.installed import print_candidates

        print_candidates(given[1:])
    elif given in (["--version"], ["--version", "--json"]):
        from navloom.installed import print_versions

        print_versions("--json" in given)
    else:
        from navloom.cli import main as run

        run()


if __name__ == "__main__":
    main()
