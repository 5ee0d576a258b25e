"""What a plugin reads from its process besides its inputs, and what it changes there."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from navloom_check.check_bench import Bench, alike
from navloom_check.checks import PLAYED, check
from navloom_check.findings import Finding
from navloom_check.process_state import PROCESS_STATE
from navloom_check.side_effects import GUARD

__all__ = ["CHECKS"]

FIRST = 3
"""Steps in which a plugin may still load files."""

_SEEDS: Mapping[str, Callable[[], Any]] = MappingProxyType({
    "random": lambda: hash(random.getstate()),
    "numpy.random": lambda: hash(np.random.get_state()[1].tobytes()),  # type: ignore[index]  # noqa: NPY002
})  # fmt: skip


@check("contract", PLAYED, "A step changes no state of the process: random seeds, environment, working folder, …")
def global_state(bench: Bench) -> Iterator[Finding]:
    """Other plugins of the process and the framework share this state. The import must not change it either."""
    scene = bench.sound()[0]
    with alike():
        before = {name: look() for name, look in _SEEDS.items()}
        player = bench.player(scene)
        for given in scene.inputs:
            player.step(given)
        seeds = [name for name, look in _SEEDS.items() if look() != before[name]]
    by_import, by_calls = PROCESS_STATE.changed()
    expected = "random numbers from context.stream(name), and no change of the process's state"
    if seeds or by_calls:
        yield Finding(f"changes {', '.join(seeds + by_calls)}", expected, given=f"scene {scene.name!r}",
                      scene=scene.name)  # fmt: skip
    elif by_import:
        yield Finding(f"changes {', '.join(by_import)} when it is imported", expected)


@check("contract", PLAYED - {"platform"}, "Calls and import use no environment variable and no working folder.")
def environment(bench: Bench) -> Iterator[Finding]:
    """These differ between the computers and services that run a robot. A platform that is a driver may use them.

    The import of the plugin counts, too.
    """
    at_import = next((deed for module, deed in GUARD.imported if bench.subject.is_own(module)), None)
    if at_import is not None:
        yield Finding(f"reads {at_import.text} when it is imported", "a parameter: a field of its Params",
                      at_import.place)  # fmt: skip
        return
    if "environment" in bench.deeds:
        deed, scene = bench.deeds["environment"]
        yield Finding(f"reads {deed.text.removeprefix('open ')}", "a parameter: a field of its Params",
                      deed.place, f"scene {scene.name!r}", scene.name)  # fmt: skip


@check("contract", PLAYED - {"platform"}, "A step reads no file: a slow disk would stop the robot.")
def reads(bench: Bench) -> Iterator[Finding]:
    """The constructor and `configure` may, and the first steps may load what they need later."""
    for scene in bench.sound():
        with alike():
            player = bench.player(scene)
            player.play(scene.inputs[:FIRST])
            GUARD.deeds.clear()
            player.play(scene.inputs[FIRST:])
        deed = next((one for one in GUARD.deeds if one.kind == "read"), None)
        if deed is not None:
            yield Finding(f"reads {deed.text.removeprefix('open ')} in a step", "to read it once, in the constructor",
                          deed.place, f"scene {scene.name!r}", scene.name)  # fmt: skip
            return


CHECKS = (global_state, environment, reads)
