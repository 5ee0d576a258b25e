"""Any-angle planning on grids for navloom: Theta* and Lazy Theta*."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the planners `lazy_theta_star` and `theta_star`."""
    from navloom_theta_star.adapter import LazyThetaStar, ThetaStar

    for planner in (LazyThetaStar, ThetaStar):
        registry.add(planner)
