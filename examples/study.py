"""A study as a script: two controllers in two worlds with the same seeds, and a table of the results.

    python examples/study.py 5            # seeds 0 to 4

This is the same study with a report:

    navloom compare building --vary controller=lyapunov_tracker,pure_pursuit \\
        --worlds doorway clutter:0 --seeds 0:5 --out results

Write a script for what the command cannot do: methods proposed by a search, or your own evaluation.
"""

import sys
from statistics import mean

from navloom_study import plan_study, run_study


def main() -> int:
    """Run the study; exit code 0 if every episode reached its goal."""
    seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
    study = plan_study(
        "building",
        vary=["controller=lyapunov_tracker,pure_pursuit"],
        worlds=["doorway", "clutter:0"],
        seeds=seeds,
    )
    result = run_study(study)
    print(f"{'controller':24} {'world':16} {'reached':>8} {'time, s':>8} {'cross-track, m':>15}")
    for method in study.methods:
        for world in study.worlds:
            rows = [row for row in result.rows if (row.key.method, row.key.world) == (method.name, world.ref)]
            reached = mean(row.outcome == "succeeded" for row in rows)
            time, beside = (mean(row.metrics[name] or 0.0 for row in rows) for name in ("time", "cross_track_rms"))
            print(f"{method.name:24} {world.ref:16} {reached:8.0%} {time:8.1f} {beside:15.3f}")
    return 0 if all(row.outcome == "succeeded" for row in result.rows) else 1


if __name__ == "__main__":
    sys.exit(main())
