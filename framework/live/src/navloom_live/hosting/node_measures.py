"""What a process measures of its nodes for their descriptions: steps, punctuality, and free shared memory."""

from __future__ import annotations

import os
from dataclasses import replace

from navloom_live.live.description import Description
from navloom_live.live.live_gate import LiveGate
from navloom_live.live.live_platform import LivePlatform
from navloom_live.live.live_runner import LiveRunner

__all__ = ["shared_memory_mb", "usual_step", "with_punctuality"]

USUAL = 64
"""Number of steps whose median is reported as the usual duration."""
FEW_CHAINS = 100
"""Fewest ticks for statistics on how long their commands take."""


def usual_step(runner: LiveRunner | None) -> float | None:
    """Median duration of the newest steps, s; None before the first."""
    steps = sorted(spent for _, spent in runner.times.newest(USUAL)) if runner is not None else []
    return steps[len(steps) // 2] * 1e-9 if steps else None


def with_punctuality(told: Description, runner: LiveRunner | None) -> Description:
    """With late ticks and stops of a platform, and how long a tick's commands take to arrive at a gate."""
    if isinstance(runner, LivePlatform):
        late, own = runner.late, runner.own
        return replace(
            told, ticks=runner.ticks, late_ticks=late, stops=runner.stops, driven_ticks=runner.driven, own_ticks=own
        )
    if isinstance(runner, LiveGate) and len(runner.chains_s) >= FEW_CHAINS:
        chains = sorted(runner.chains_s.copy())
        return replace(told, chain_p50_s=chains[len(chains) // 2], chain_p99_s=chains[len(chains) * 99 // 100])
    return told


def shared_memory_mb() -> float | None:
    """Free shared memory of this host, MiB, which large messages between its processes need; None without any."""
    try:
        status = os.statvfs("/dev/shm")
    except OSError:
        return None
    return status.f_bavail * status.f_frsize / 2**20
