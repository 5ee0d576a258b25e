"""Checks as tests: the pytest plugin that comes with navloom."""

import pytest


@pytest.mark.navloom_plugin("recovery.wait_and_replan", tiers=["contract"])
def test_a_recovery_of_the_framework_passes(plugin_check):
    plugin_check()


def test_a_fixture_without_its_mark_says_what_is_missing(tmp_path):
    import subprocess
    import sys

    (tmp_path / "test_it.py").write_text("def test_it(plugin_check):\n    plugin_check()\n")
    ran = subprocess.run([sys.executable, "-m", "pytest", "-q", str(tmp_path)], capture_output=True, text=True)
    assert ran.returncode != 0 and "mark it with @pytest.mark.navloom_plugin('avoider.demo')" in ran.stdout + ran.stderr
