"""Fuzzing of all readers of files and messages: `python benchmarks/fuzz/run.py` writes the report."""
