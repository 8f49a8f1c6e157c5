"""Worker that evaluates a baseline in another interpreter: reads signals and folds, writes predictions.

It does not import texclass. It needs numpy, scikit-learn and the packages of the baseline.
"""
