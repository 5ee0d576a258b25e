"""Vector field histograms on range sensors for navloom: VFH (1991), VFH+ (1998) and VFH* (2000)."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the avoiders `vfh`, `vfh_plus` and `vfh_star`."""
    from navloom_vfh.adapter import Vfh, VfhPlus, VfhStar

    for avoider in (Vfh, VfhPlus, VfhStar):
        registry.add(avoider)
