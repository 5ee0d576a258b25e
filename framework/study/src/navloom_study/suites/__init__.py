"""Suites: named, versioned sets of worlds, conditions and seeds with one primary metric, and their checked results.

Begin with `suite.py` (the file of a suite), then `suite_run.py` (its studies), `result_file.py` (what they give) and
`verification.py` (how a result is checked). `results_page.py` makes the page of all results.
"""
