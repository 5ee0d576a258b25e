"""Any-angle paths as navloom planners."""

from __future__ import annotations

from navloom import Claim
from navloom_astar.adapter import PlannerOnGrid

from navloom_theta_star import search
from navloom_theta_star.search import LazyThetaSearch, ThetaSearch

__all__ = ["LazyThetaStar", "ThetaStar"]


class ThetaStar(PlannerOnGrid):
    """Any-angle paths on a grid (Nash, Daniel, Koenig & Felner 2007)."""

    name = "theta_star"
    claims = {*PlannerOnGrid.claims, Claim.OPTIMAL_ANY_ANGLE}
    search = ThetaSearch

    @classmethod
    def warm_up(cls) -> None:
        super().warm_up()
        search.warm_up()


class LazyThetaStar(ThetaStar):
    """Any-angle paths with one line-of-sight check per expanded cell (Nash, Koenig & Tovey 2010)."""

    name = "lazy_theta_star"
    search = LazyThetaSearch
