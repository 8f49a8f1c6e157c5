"""Every reader of files and messages fed with rubbish: `python tests/fuzz/run.py` writes the report."""
