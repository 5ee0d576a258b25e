"""Episodes, metrics and reports: what a run was like."""
