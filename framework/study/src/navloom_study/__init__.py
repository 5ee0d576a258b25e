"""Episodes, metrics and studies. A plugin that adds a metric imports only what is listed here."""

from navloom.runs.metrics import METRICS, Metric
from navloom.runs.trail import Trail

__all__ = ["METRICS", "Metric", "Trail"]
