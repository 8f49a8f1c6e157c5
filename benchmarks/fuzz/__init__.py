"""Every reader of files and messages fed with rubbish: `python benchmarks/fuzz/run.py` writes the report."""
