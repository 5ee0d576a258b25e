"""Vector field histograms on range sensors for navloom: VFH (1991), VFH+ (1998), VFH* (2000) and a swept VFH*."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the avoiders `vfh`, `vfh_plus`, `vfh_star` and `vfh_swept`."""
    from navloom_vfh.adapter import Vfh, VfhPlus, VfhStar, VfhSwept

    for avoider in (Vfh, VfhPlus, VfhStar, VfhSwept):
        registry.add(avoider)
