"""Shell completion and manual pages, both generated from the command tree.

Begin with `tree.py`: the command line as data. `scripts.py` and `manual.py` print it for shells and for `man`.
"""
