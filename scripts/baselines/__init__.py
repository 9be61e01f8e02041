"""The method (earth mover, profile `paper`) written three times in Python, for `scripts/compare_speed.py`.

`with_scipy` says it plainly, `with_numpy` and `with_numba` are as fast as we could make them; `finish` has the steps
behind the measure, which cost little and are shared by the fast two. Arrays are column-major as the program's own:
shape `(n_columns, n_steps)`, C-contiguous.
"""
