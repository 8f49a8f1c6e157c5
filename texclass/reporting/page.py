"""Results of several commands as one HTML page."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from texclass.document import render_page
from texclass.reporting.result_files import read_document

TITLE = "Surfaces from what a tool felt"


def write_page(paths: Sequence[str | Path], output: str | Path, title: str = "") -> Path:
    """Read results and write a page that holds all it shows and asks for nothing outside.

    Parameters
    ----------
    paths : sequence of str or path
        JSON files, in the order of the page.
    output : str or path
        The HTML file; its folder is made if it does not exist.
    title : str
        Its title; by default the datasets'.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ValueError
        If there are none, a file is no result, or the page would replace one.
    """
    output = Path(output)
    if output.resolve() in [Path(path).resolve() for path in paths]:
        raise ValueError(f"{output} is one of the results; the rule is a file of its own")
    read = [(Path(path).name, read_document(path)) for path in paths]
    counts = Counter(document.title for _, document in read)
    documents = []
    for file, document in read:
        # Results of equal titles are told apart by their pipelines, or else by their files.
        told = document.subtitle.partition(":")[0] if document.data else file
        told_apart = f"{document.title}: {told}" if counts[document.title] > 1 else document.title
        documents.append(replace(document, title=told_apart, again={"File": file, **document.again}))
    names = list(dict.fromkeys(document.data[0] for document in documents if document.data))
    page = render_page(
        documents,
        title or (f"{TITLE}: {', '.join(names)}" if 0 < len(names) <= 3 else TITLE),
        written_by="texclass report",
    )
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(page, encoding="utf-8")
    return output
