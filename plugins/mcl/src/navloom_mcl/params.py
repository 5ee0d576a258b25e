"""Parameters of the localizer, as a config file gives them."""

from __future__ import annotations

import math

from navloom import Params
from navloom_scans.anywhere import SearchSettings
from pydantic import Field, model_validator

from navloom_mcl.belief import BeliefSettings
from navloom_mcl.filter import FilterSettings

__all__ = ["MclParams"]


class MclParams(Params):
    """Lengths in m. The README explains each."""

    occupied_from: int = Field(50, ge=1, le=100, description="Cells of at least this are walls, percent.")
    unknown_is_wall: bool = Field(False, description="Unknown cells are walls.")
    least_particles: int = Field(500, ge=10, le=100_000, description="Least number of particles.")
    most_particles: int = Field(5000, ge=10, le=100_000, description="Largest number of particles.")
    kld_error: float = Field(0.05, gt=0.0, le=1.0, description="Largest Kullback-Leibler distance of the particles.")
    start_sigma: float = Field(0.05, gt=0.0, le=1.0, description="Uncertainty of a known start's x and y, m.")
    start_sigma_deg: float = Field(2.0, gt=0.0, le=30.0, description="Uncertainty of its heading, degrees.")
    way_noise: float = Field(0.05, gt=0.0, le=1.0, description="Spread of odometry after 1 m, m/sqrt(m).")
    heading_per_way_deg: float = Field(
        3.0, gt=0.0, le=60.0, description="Spread of its heading after 1 m, degrees/sqrt(m)."
    )
    heading_per_turn_deg: float = Field(
        3.0, gt=0.0, le=60.0, description="Spread of its heading after a turn of 1 rad, degrees/sqrt(rad)."
    )
    rest_noise: float = Field(0.002, ge=0.0, le=0.1, description="Spread after 1 s at rest, m/sqrt(s).")
    rest_noise_deg: float = Field(0.1, ge=0.0, le=5.0, description="Spread of heading after 1 s, degrees/sqrt(s).")
    beams: int = Field(60, ge=5, le=1000, description="Beams of a scan that are used.")
    sigma: float = Field(0.08, gt=0.0, le=1.0, description="Standard deviation of a beam's end from its wall, m.")
    unmapped: float = Field(
        0.2, gt=0.0, lt=1.0, description="Likelihood of an echo before a wall, relative to a hit, no unit."
    )
    through: float = Field(0.05, gt=0.0, lt=1.0, description="The same of an echo behind a wall, no unit.")
    silent: float = Field(0.3, gt=0.0, lt=1.0, description="The same of a missing echo where a wall is, no unit.")
    redundancy: float = Field(6.0, ge=1.0, le=1000.0, description="Number of beams that count as one.")
    reach: float = Field(0.5, gt=0.0, le=5.0, description="Longest distance at which a wall is searched, m.")
    update_way: float = Field(0.1, ge=0.0, le=5.0, description="Way from one used scan to the next, m.")
    update_turn_deg: float = Field(5.0, ge=0.0, le=90.0, description="Turn from one used scan to the next, degrees.")
    candidates: int = Field(40, ge=1, le=64, description="Places that a search returns at most.")
    search_work: int = Field(30_000, ge=100, le=10_000_000, description="Work of a search in one tick, nodes.")
    search_way: float = Field(0.5, gt=0.0, le=10.0, description="Way between two searches, m.")
    sure_weight: float = Field(0.9, gt=0.5, le=1.0, description="Least weight of one place for tracking.")
    prove_way: float = Field(1.0, ge=0.0, le=100.0, description="Way along which a found place must fit, m.")
    trusted_share: float = Field(
        0.6, ge=0.0, le=1.0, description="Share of beams to a mapped wall that must end at it, no unit."
    )
    patience: float = Field(0.5, ge=0.0, le=60.0, description="How long the state must be contradicted to change, s.")
    lost_after: float = Field(60.0, ge=0.0, le=3600.0, description="Searching after which the robot is lost, s.")
    lost_sigma: float = Field(0.5, gt=0.0, le=100.0, description="Spread of the position above which it searches, m.")
    max_half_angle_deg: float = Field(1.0, ge=0.0, le=10.0, description="Wider beams are left out, degrees.")
    limit_margin: float = Field(0.05, ge=0.0, le=1.0, description="Readings this near to range_max are none, m.")
    max_age: float = Field(0.5, ge=0.0, le=5.0, description="Scans this much older than odometry are left out, s.")

    @model_validator(mode="after")
    def _check(self) -> MclParams:
        if self.least_particles > self.most_particles:
            given = f"{self.least_particles} and {self.most_particles}"
            raise ValueError(f"least_particles and most_particles: got {given}, expected at most the second")
        return self

    def filter(self) -> FilterSettings:
        """The same for the filter."""
        return FilterSettings(
            least=self.least_particles,
            most=self.most_particles,
            kld_error=self.kld_error,
            way_noise=self.way_noise,
            turn_per_way=math.radians(self.heading_per_way_deg),
            turn_noise=math.radians(self.heading_per_turn_deg),
            rest_noise=self.rest_noise,
            rest_turn_noise=math.radians(self.rest_noise_deg),
            beams=self.beams,
            sigma=self.sigma,
            short=self.unmapped,
            through=self.through,
            silent=self.silent,
            redundancy=self.redundancy,
        )

    def belief(self) -> BeliefSettings:
        """The same for the belief."""
        return BeliefSettings(
            start_sigma=self.start_sigma,
            start_turn_sigma=math.radians(self.start_sigma_deg),
            update_way=self.update_way,
            update_turn=math.radians(self.update_turn_deg),
            candidates=self.candidates,
            search_work=self.search_work,
            search_way=self.search_way,
            sure_weight=self.sure_weight,
            prove_way=self.prove_way,
            trusted_share=self.trusted_share,
            patience=self.patience,
            lost_after=self.lost_after,
            lost_sigma=self.lost_sigma,
        )

    def search(self) -> SearchSettings:
        """The same for the search."""
        return SearchSettings(reach=self.reach)
