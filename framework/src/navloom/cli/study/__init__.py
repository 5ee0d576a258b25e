"""Commands that work without a live robot: one run, many runs, one plan, one map."""
