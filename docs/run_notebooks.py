"""Run scripts of the gallery as notebooks, each in an empty folder.

`python docs/run_notebooks.py [NAME ...]` runs all of them if no name is given. The notebooks are those that
the pages of the gallery offer for download. Requires the extra `docs`.
"""

import shutil
import sys
import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellControlSignal, DeadKernelError
from sphinx_gallery.notebook import python_to_jupyter_cli

EXAMPLES = Path(__file__).parents[1] / "examples"
TIMEOUT_S = 900
"""Longest time that one cell may take, in s."""


def scripts() -> dict[str, Path]:
    """Return the scripts of the gallery by name."""
    headers = EXAMPLES.glob("*/GALLERY_HEADER.rst")
    return {path.stem: path for header in sorted(headers) for path in sorted(header.parent.glob("*.py"))}


def run(script: Path) -> None:
    """Convert a script to a notebook and execute it in an empty folder."""
    with tempfile.TemporaryDirectory() as conversion, tempfile.TemporaryDirectory() as empty:
        copy = Path(shutil.copy(script, conversion))
        python_to_jupyter_cli([str(copy)])
        notebook = nbformat.read(copy.with_suffix(".ipynb"), as_version=4)
        NotebookClient(
            notebook, timeout=TIMEOUT_S, kernel_name="python3", resources={"metadata": {"path": empty}}
        ).execute()


def main(names: list[str]) -> int:
    """Run the notebooks and return the number of those that fail."""
    available = scripts()
    if unknown := set(names) - set(available):
        sys.exit(f"unknown scripts: {', '.join(sorted(unknown))}. Expected some of {', '.join(available)}")
    failures = []
    for name in names or available:
        start, outcome = time.perf_counter(), "ran"
        try:
            run(available[name])
        except (CellControlSignal, DeadKernelError) as error:
            failures.append(name)
            outcome = "failed"
            print(error)
        print(f"{name}: {outcome} in {time.perf_counter() - start:.0f} s", flush=True)
    if failures:
        print(f"failed: {', '.join(failures)}")
    return len(failures)


if __name__ == "__main__":
    sys.exit(bool(main(sys.argv[1:])))
