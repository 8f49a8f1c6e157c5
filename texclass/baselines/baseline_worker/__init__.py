"""Worker that runs in another interpreter and evaluates one baseline on signals and folds read from files.

The worker does not import texclass. It needs NumPy, scikit-learn and the packages of the baseline.
"""
