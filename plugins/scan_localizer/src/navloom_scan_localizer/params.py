"""Parameters of the localizers, as a config file gives them."""

from __future__ import annotations

import math
from dataclasses import replace

from navloom import Params
from pydantic import Field

from navloom_scan_localizer.tracking import Settings

__all__ = ["ScanMatchingParams", "ScanOdometryParams"]


class ScanMatchingParams(Params):
    """Lengths in m. The README gives the source of each default."""

    occupied_from: int = Field(50, ge=1, le=100, description="Cells of at least this are walls, percent.")
    unknown_is_wall: bool = Field(False, description="Unknown cells are walls.")
    start_sigma: float = Field(0.05, gt=0.0, le=1.0, description="Uncertainty of the start's x and y, m.")
    start_sigma_deg: float = Field(2.0, gt=0.0, le=30.0, description="Uncertainty of the start's heading, degrees.")
    way_noise: float = Field(0.02, gt=0.0, le=0.5, description="Spread of odometry after 1 m, m/sqrt(m).")
    heading_per_way_deg: float = Field(
        1.5, gt=0.0, le=30.0, description="Spread of its heading after 1 m, degrees/sqrt(m)."
    )
    heading_per_turn_deg: float = Field(
        1.5, gt=0.0, le=30.0, description="Spread of its heading after a turn of 1 rad, degrees/sqrt(rad)."
    )
    rest_noise: float = Field(0.002, gt=0.0, le=0.1, description="Spread after 1 s at rest, m/sqrt(s).")
    rest_noise_deg: float = Field(0.1, gt=0.0, le=5.0, description="Spread of heading after 1 s, degrees/sqrt(s).")
    sigma: float = Field(0.02, gt=0.0, le=1.0, description="Standard deviation of a beam's end from its wall, m.")
    redundancy: float = Field(
        4.0, ge=1.0, le=1000.0, description="Number of beams that count as one independent measurement."
    )
    robust_scale: float = Field(0.08, gt=0.0, le=2.0, description="Misfit above which a beam has little weight, m.")
    reach: float = Field(
        0.5, gt=0.0, le=5.0, description="Longest distance from a beam's end at which a wall is searched, m."
    )
    least_inliers: int = Field(20, ge=3, le=10_000, description="Beams that must fit the map, or a scan is left out.")
    least_share: float = Field(0.3, ge=0.0, le=1.0, description="Share of its echoes that must fit, no unit.")
    iterations: int = Field(8, ge=1, le=100, description="Largest number of steps of a fit.")
    max_shift: float = Field(
        0.02, gt=0.0, le=1.0, description="Largest correction of the reported position in a tick of a drive, m."
    )
    max_turn_deg: float = Field(
        2.0, gt=0.0, le=45.0, description="Largest correction of the reported heading in a tick of a drive, degrees."
    )
    max_half_angle_deg: float = Field(1.0, ge=0.0, le=10.0, description="Wider beams are left out, degrees.")
    limit_margin: float = Field(0.05, ge=0.0, le=1.0, description="Readings this near to range_max are none, m.")
    max_age: float = Field(0.5, ge=0.0, le=5.0, description="Scans this much older than odometry are left out, s.")

    least_seen: float = Field(
        0.05, ge=0.0, le=1.0, description="Share of beams that must see what the map has at the start."
    )
    trusted_share: float = Field(
        0.6, ge=0.0, le=1.0, description="Share of beams to a mapped wall that must end at it, not behind it, no unit."
    )
    sure_share: float = Field(0.9, ge=0.0, le=1.0, description="Share of echoes from which no other pose is searched.")
    search_reach: float = Field(0.7, ge=0.0, le=5.0, description="Range of the search around the pose, m.")
    search_turn_deg: float = Field(20.0, ge=0.0, le=180.0, description="Range of the search in heading, degrees.")
    search_every: float = Field(1.0, ge=0.0, le=60.0, description="Time between two searches, s.")
    patience: float = Field(
        0.5, ge=0.0, le=60.0, description="How long scans must fit, or not fit, to change the state, s."
    )
    lost_after: float = Field(
        3.0, ge=0.0, le=600.0, description="Duration of searching after which the robot is lost, s."
    )
    lost_sigma: float = Field(
        1.0, gt=0.0, le=100.0, description="Spread of the position above which it is not trusted, m."
    )

    def settings(self) -> Settings:
        """The same for the pure modules."""
        return Settings(
            start_sigma=self.start_sigma,
            start_turn_sigma=math.radians(self.start_sigma_deg),
            way_noise=self.way_noise,
            turn_per_way=math.radians(self.heading_per_way_deg),
            turn_noise=math.radians(self.heading_per_turn_deg),
            rest_noise=self.rest_noise,
            rest_turn_noise=math.radians(self.rest_noise_deg),
            sigma=self.sigma,
            redundancy=self.redundancy,
            robust_scale=self.robust_scale,
            reach=self.reach,
            least_inliers=self.least_inliers,
            least_share=self.least_share,
            iterations=self.iterations,
            max_shift=self.max_shift,
            max_turn=math.radians(self.max_turn_deg),
            least_seen=self.least_seen,
            trusted_share=self.trusted_share,
            sure_share=self.sure_share,
            search_reach=self.search_reach,
            search_turn=math.radians(self.search_turn_deg),
            search_every=self.search_every,
            patience=self.patience,
            lost_after=self.lost_after,
            lost_sigma=self.lost_sigma,
        )


class ScanOdometryParams(Params):
    """Lengths in m."""

    way_noise: float = Field(0.02, gt=0.0, le=0.5, description="Spread of odometry after 1 m, m/sqrt(m).")
    heading_per_way_deg: float = Field(
        3.0, gt=0.0, le=30.0, description="Spread of its heading after 1 m, degrees/sqrt(m)."
    )
    heading_per_turn_deg: float = Field(
        3.0, gt=0.0, le=30.0, description="Spread of its heading after a turn of 1 rad, degrees/sqrt(rad)."
    )
    rest_noise: float = Field(0.002, ge=0.0, le=2.0, description="Spread of odometry in 1 s at rest, m/sqrt(s).")
    rest_turn_noise_deg: float = Field(
        0.1, ge=0.0, le=90.0, description="Spread of its heading in 1 s at rest, degrees/sqrt(s)."
    )
    drift: float = Field(0.01, ge=0.0, le=0.5, description="Spread of the scan matching after 1 m, m/sqrt(m).")
    drift_deg: float = Field(0.2, ge=0.0, le=30.0, description="The same of the heading, degrees/sqrt(m).")
    sigma: float = Field(0.03, gt=0.0, le=1.0, description="Standard deviation of a beam's end, m.")
    redundancy: float = Field(
        4.0, ge=1.0, le=1000.0, description="Number of beams that count as one independent measurement."
    )
    robust_scale: float = Field(0.1, gt=0.0, le=2.0, description="Misfit above which a beam has little weight, m.")
    reach: float = Field(
        0.3, gt=0.0, le=5.0, description="Longest distance from a beam's end at which a surface is searched, m."
    )
    least_inliers: int = Field(20, ge=3, le=10_000, description="Beams that must fit, or a scan is left out.")
    iterations: int = Field(8, ge=1, le=100, description="Largest number of steps of a fit.")
    spacing: float = Field(0.05, gt=0.0, le=0.5, description="Distance between the nodes of the surfaces' lattice, m.")
    before: float = Field(0.2, gt=0.0, le=2.0, description="Depth of a surface towards the sensor, m.")
    behind: float = Field(0.1, gt=0.0, le=2.0, description="Depth of a surface away from the sensor, m.")
    memory: float = Field(60.0, ge=1.0, le=10_000.0, description="Number of beams over which a surface is averaged.")
    key_way: float = Field(0.1, ge=0.0, le=5.0, description="Distance after which a scan is added to the surfaces, m.")
    key_turn_deg: float = Field(
        5.0, ge=0.0, le=180.0, description="Turn after which a scan is added to the surfaces, degrees."
    )
    first_scans: int = Field(10, ge=1, le=1000, description="Scans at the start that are always added to the surfaces.")
    max_range: float = Field(8.0, gt=0.0, le=100.0, description="Longer readings are left out, m.")
    max_half_angle_deg: float = Field(1.0, ge=0.0, le=10.0, description="Wider beams are left out, degrees.")
    limit_margin: float = Field(0.05, ge=0.0, le=1.0, description="Readings this near to range_max are none, m.")
    max_age: float = Field(0.5, ge=0.0, le=5.0, description="Scans this much older than odometry are left out, s.")
    lost_sigma: float = Field(
        1.0, gt=0.0, le=100.0, description="Spread of the position above which it is not trusted, m."
    )

    def settings(self) -> Settings:
        """The same for the pure modules."""
        return Settings(
            start_sigma=1e-3,
            start_turn_sigma=1e-3,
            way_noise=self.way_noise,
            turn_per_way=math.radians(self.heading_per_way_deg),
            turn_noise=math.radians(self.heading_per_turn_deg),
            rest_noise=self.rest_noise,
            rest_turn_noise=math.radians(self.rest_turn_noise_deg),
            sigma=self.sigma,
            redundancy=self.redundancy,
            robust_scale=self.robust_scale,
            reach=self.reach,
            least_inliers=self.least_inliers,
            least_share=0.0,
            iterations=self.iterations,
            max_shift=math.inf,
            max_turn=math.inf,
            lost_sigma=self.lost_sigma,
            is_doubted=False,
        )

    def unaided(self) -> Settings:
        """The settings for a robot whose odometry is missing: the spread covers 1 m/s² and 5 rad/s² between scans."""
        return replace(self.settings(), rest_noise=0.3, rest_turn_noise=math.radians(30.0))
