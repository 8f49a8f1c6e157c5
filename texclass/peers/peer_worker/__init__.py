"""What another interpreter runs: signals and folds from files, a peer's features, predictions to files.

Imports nothing of texclass: numpy, scikit-learn and the peer's own package are all it needs.
"""
