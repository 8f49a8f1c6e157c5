"""What another interpreter runs: signals and folds from files, a baseline's features, predictions to files.

Imports nothing of texclass: numpy, scikit-learn and the baseline's own package are all it needs.
"""
