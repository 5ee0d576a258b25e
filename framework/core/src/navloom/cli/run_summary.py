"""The result of a run for people: its numbers, its faults, and whether it reached its goal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import typer

from navloom.cli.output import LOG, print_table
from navloom.cli.tracebacks import with_traceback_of
from navloom.parts import has_part, part

__all__ = ["is_reached", "print_summary", "tell_faults"]

LABELS = {
    "plan_length_m": "plan, before pruning, m",
    "path_length_m": "driven, m",
    "optimal_to_tolerance_m": "shortest path, to within the goal's tolerance, m",
    "goal_error_m": "true distance from the goal, m",
    "min_clearance_m": "minimum clearance, m",
    "cross_track_rms_m": "cross-track rms, m",
    "cross_track_max_m": "cross-track max, m",
    "collisions": "collisions",
    "own_contacts": "of these the robot's own",
    "recoveries": "recoveries",
    "gate_limits": "slowed by the gate's monitor",
    "sim_time_s": "robot time, s",
    "wall_s": "wall-clock time, s",
    "trace_sha256": "trace",
}


def is_reached(summary: Mapping[str, Any]) -> bool:
    """Whether the goal was reached according to the robot, and to the ground truth if there is one."""
    return summary["outcome"] == "succeeded" and summary["truly_reached"] is not False


def tell_faults(episode: Any, summary: Mapping[str, Any], recording: Path | None = None) -> None:
    """Log faults of plugins, each with the command that repeats a recorded step, and other problems."""
    for fault, (role, name, tick) in zip(episode.log.faults, episode.log.failed, strict=True):
        text = fault
        if recording is not None:
            is_only = sum(owner == role for owner, _ in episode.system.parts) == 1
            repeating = part("navloom_recording.excerpt").repeating
            text += f"\nrepeat that step: {repeating(recording, role, name, tick, is_only)}"
        LOG.warning(text, extra=with_traceback_of(fault))
    for warning in summary["warnings"]:
        LOG.warning(f"warning: {warning['text']}")


def print_summary(episode: Any, summary: Mapping[str, Any]) -> None:
    """Print a run's result for people."""
    told_of = {key: label for key, label in LABELS.items() if key != "own_contacts" or summary["collisions"]}
    rows: list[tuple[str, Any]] = [(label, summary[key]) for key, label in told_of.items() if summary[key] is not None]
    if summary["pose_error_m"] is not None:
        error = summary["pose_error_m"]
        rows.append(("pose error rms, p95, max, m", f"{error['rms']:.3g}, {error['p95']:.3g}, {error['max']:.3g}"))
    end = episode.result.place
    told = f"{summary['outcome']}: {summary['reason']}"
    if summary["outcome"] == "succeeded" and summary["truly_reached"] is False:
        told = episode.trail.reason
    elif summary["outcome"] == "collision":
        told = f"collision: {episode.trail.reason}"  # a robot feels a contact, but not who made it
    typer.echo(f"{told}, at ({end.x:z.2f}, {end.y:z.2f})")
    if summary["truly_reached"] is None:
        typer.echo("no ground truth: the robot's estimate of its pose is not checked")
    elif episode.system.world is None:
        typer.echo("the platform describes no world: the shortest path is unknown; start and goal were not checked")
    elif not has_part("navloom_optimal"):
        typer.echo("the shortest path is unknown: pip install navloom-optimal")
    print_table(("", ""), rows)
    if summary["shadows"]:
        _print_shadows(summary["shadows"])


def _print_shadows(shadows: Sequence[Mapping[str, Any]]) -> None:
    """Print the differences of the shadows for people."""
    from navloom.engine.difference_units import UNITS

    lines = []
    for one in shadows:
        sizes = one["differences"].items()
        worst = ", ".join(f"{name} {size['rms']:.3g}/{size['max']:.3g} {UNITS[name]}" for name, size in sizes)
        share = one["differing_share"]
        told = "-" if share is None else f"{100.0 * share:.1f} %"
        lines.append((f"{one['role']} {one['instance']}", one["ticks"], told, one["first_differing_s"], worst or None))
    print_table(("in shadow", "ticks", "differing", "first at, s", "difference, rms/max"), lines)
