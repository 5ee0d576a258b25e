"""Parameters of `global_matching`, as a config file gives them: those of `scan_matching`, and those of the search."""

from __future__ import annotations

from navloom_scan_localizer.params import ScanMatchingParams
from navloom_scans.anywhere import SearchSettings
from pydantic import Field

from navloom_mcl.global_matching.supervisor import SearchLimits

__all__ = ["GlobalMatchingParams"]


class GlobalMatchingParams(ScanMatchingParams):
    """Lengths in m. The README explains each."""

    candidates: int = Field(40, ge=1, le=64, description="Places that one search of the map returns at most.")
    search_work: int = Field(60_000, ge=100, le=10_000_000, description="Work of a search in one tick, nodes.")
    prove_way: float = Field(
        0.8, gt=0.0, le=100.0, description="Way along which a found place must fit, m; a turn of 1 rad counts as 0.3 m."
    )
    sure_weight: float = Field(0.99, gt=0.5, lt=1.0, description="Least weight of a place that is tracked.")
    give_up_after: float = Field(
        120.0, ge=0.0, le=3600.0, description="Duration of a search after which the robot is lost, s."
    )

    def limits(self) -> SearchLimits:
        """The limits of the search."""
        return SearchLimits(self.search_work, self.candidates, self.prove_way, self.sure_weight)

    def search(self) -> SearchSettings:
        """The settings of the search of the map."""
        return SearchSettings(
            sigma=self.sigma, redundancy=self.redundancy, robust_scale=self.robust_scale, reach=self.reach
        )
