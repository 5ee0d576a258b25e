"""Run uv in this checkout: `python3 uv.py run navloom run paper`. The first call installs uv into the folder `.uv`.

It works with any Python 3.11 or newer that has pip or venv, whether the system, pyenv, conda or a virtual environment
provides it, and writes only here where there is no home to write to. It parses under Python 3.6 too, so that an old
Python gets one sentence and not a syntax error.
"""

import importlib.util
import os
import shlex
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
UV = os.path.join(HERE, ".uv")
REQUIREMENT = "uv~=0.8"
OLDEST = (3, 11)


class Unusable(Exception):
    """This Python cannot be used, with the sentence that says what to do."""


def main() -> int:
    """Replace this process by uv with the same arguments."""
    try:
        check_python()
        if not os.path.exists(UV):
            install()
        program = os.path.join(UV, "bin", "uv")
        os.execve(program, [program, *sys.argv[1:]], environment())
    except Unusable as error:
        print(f"error: {error}", file=sys.stderr)
    except OSError as error:
        print(f"error: {error}; where the folder {UV} exists, delete it and try again", file=sys.stderr)
    except KeyboardInterrupt:
        return 130
    return 2


def check_python() -> None:
    """Refuse a Python that is too old, before anything is installed with it."""
    if sys.version_info < OLDEST:
        given = " ".join(shlex.quote(word) for word in ["uv.py", *sys.argv[1:]])
        raise Unusable(
            f"navloom needs Python 3.11 or newer, and {sys.executable} is Python {sys.version.split()[0]}; "
            f"run the command with a newer one, for example `python3.12 {given}`"
        )


def install() -> None:
    """Install uv into a folder of its own; with `--target`, pip may do so for a system's Python (PEP 668) too."""
    print(f"Installing uv into {UV} ...", file=sys.stderr)
    with tempfile.TemporaryDirectory(dir=HERE, prefix=".uv-") as fresh:
        target = os.path.join(fresh, "uv")
        options = ["--quiet", "--disable-pip-version-check", "--no-cache-dir", "--no-user", "--root-user-action=ignore"]
        command = [python_with_pip(fresh), "-m", "pip", "install", *options, "--target", target, REQUIREMENT]
        if subprocess.call(command, env=dict(os.environ, PIP_REQUIRE_VIRTUALENV="0")) != 0:
            raise Unusable(f"pip did not install {REQUIREMENT}, for the reason above")
        os.rename(target, UV)


def python_with_pip(fresh: str) -> str:
    """This Python, or where it has no pip that of a virtual environment in the folder `fresh`."""
    if importlib.util.find_spec("pip"):
        return sys.executable
    folder = os.path.join(fresh, "pip")
    done = subprocess.run([sys.executable, "-m", "venv", folder], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    if done.returncode != 0:
        raise Unusable(
            f"{sys.executable} has neither pip nor a venv that can install it; install one of them, on Debian and "
            "Ubuntu with `apt install python3-venv`, and run the command again"
        )
    return os.path.join(folder, "bin", "python")


def environment() -> "dict[str, str]":
    """The environment of uv: this Python, and a cache in this checkout where there is no home to keep one in."""
    given = dict(os.environ)
    given.pop("VIRTUAL_ENV", None)  # the checkout has a virtual environment of its own, .venv
    given.setdefault("UV_PYTHON", getattr(sys, "_base_executable", sys.executable))
    caches = given.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if not writable(os.path.join(caches, "uv")):
        given.setdefault("UV_CACHE_DIR", os.path.join(UV, "cache"))
    return given


def writable(folder: str) -> bool:
    """Whether files can be made in a folder, which is made where it is missing."""
    if not os.path.isabs(folder):  # `~` of a user without a home
        return False
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


if __name__ == "__main__":
    sys.exit(main())
