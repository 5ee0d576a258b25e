"""Episodes, metrics and reports: what a run was like. Plugins that add a metric need no more than this."""

from navloom.study.metrics import METRICS, Metric
from navloom.study.trail import Trail

__all__ = ["METRICS", "Metric", "Trail"]
