import subprocess
import sys

PLAIN = ("world", "angles", "frames", "footprints", "collision", "grid", "solids")


def test_plain_geometry_loads_no_compiler() -> None:
    """Keeps `navloom --help` fast."""
    imports = ", ".join(f"navloom.geometry.{module}" for module in PLAIN)
    code = f"import sys, {imports}; print([m for m in ('numba', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
