"""Pages of saved results, and which of them are stale."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from texclass.atomic_write import check_suffix, write_atomic

# Importing the modules of results registers their kinds.
from texclass.baselines import comparison  # noqa: F401
from texclass.cli import invariance_document  # noqa: F401
from texclass.evaluation import new_feature  # noqa: F401
from texclass.evaluation.pipeline import load_pipeline
from texclass.evaluation.result import COMPUTED_BY
from texclass.features.sets import load_feature_set
from texclass.provenance import code_hash
from texclass.reporting import Document, render_markdown, render_page
from texclass.reporting.result_files import Result, read_result
from texclass.stability import battery  # noqa: F401
from texclass.tradeoff import study  # noqa: F401


def read_document(path: str | Path) -> Document:
    """Read a result that a command wrote as JSON, as a document.

    Parameters
    ----------
    path : str or path
        A JSON file.

    Raises
    ------
    ValueError
        If it is no result, or damaged; the message names file and value.
    OSError
        If it cannot be read.
    """
    result = read_result(path, _shown)
    with refusing_damage(str(path)):
        return result.document()


def _shown(text: str) -> float:
    """Return a number of a result; refuse what no figure can show."""
    if not abs(float(text)) <= 1e100:
        raise ValueError(f"number {text:.40}, expected at most 1e100 in magnitude")
    return int(text) if text.removeprefix("-").isdigit() else float(text)


@contextmanager
def refusing_damage(files: str) -> Iterator[None]:
    """Name the files if their values, which nobody checked, cannot be shown."""
    try:
        yield
    except (ValueError, TypeError, LookupError, ArithmeticError, AttributeError) as error:
        raise ValueError(
            f"{files}: cannot be shown ({type(error).__name__}: {error}). Write it again with its command"
        ) from error


def stale_results(paths: Sequence[str | Path]) -> tuple[dict[Path, str], dict[Path, str]]:
    """Return the results to be made again, and the files that contain no result, each with the reason.

    A result is made again where its code, pipeline or features have changed; comments, docstrings and the
    modules that put results into words do not count as code.

    Parameters
    ----------
    paths : sequence of str or path
        JSON files.

    Returns
    -------
    dict of Path to str
        Results to be made again.
    dict of Path to str
        Skipped files: folders, and files that contain no result.

    Raises
    ------
    OSError
        If a file does not exist or cannot be read.
    """
    stale, skipped = dict[Path, str](), dict[Path, str]()
    for path in map(Path, paths):
        if path.is_dir():
            skipped[path] = "is a folder"
            continue
        try:
            result = read_result(path)
            with refusing_damage(str(path)):
                reasons = [*_changed_code(result), *_changed_definitions(result)]
        except ValueError as error:
            skipped[path] = str(error).removeprefix(f"{path}: ")
            continue
        if reasons:
            stale[path] = "; ".join(reasons)
    return stale, skipped


_hash_of_code = cache(partial(code_hash, words=False))


def _changed_code(result: Result) -> Iterator[str]:
    """Yield why the code of a result is not today's."""
    if not result.data.get("code_hash"):
        yield "made before results carried a hash of their code"
        return
    places = result.data.get("code_of", COMPUTED_BY)
    if foreign := [place for place in places if not place.isidentifier()]:
        raise ValueError(f"code_of names {foreign[0]!r}, expected subpackages and modules of texclass")
    try:
        is_same = result.data["code_hash"] == _hash_of_code(*places)
    except ValueError:  # a subpackage that is gone
        is_same = False
    if not is_same:
        yield "made by other code"


def _changed_definitions(result: Result) -> Iterator[str]:
    """Yield which pipeline or feature set of a result has changed."""
    loaders: dict[str, Callable[[str], Any]] = {"pipeline": load_pipeline, "feature set": load_feature_set}
    for what, (name, digest) in result.definitions.items():
        if name and digest:
            try:
                if loaders[what](name).hash != digest:
                    yield f"{what} {name} has changed"
            except (ValueError, OSError):
                yield f"{what} {name} is not here"


def write_page(paths: Sequence[str | Path], output: str | Path, title: str = "") -> Path:
    """Read results and write a page that holds all it shows and asks for nothing outside, or their Markdown.

    Parameters
    ----------
    paths : sequence of str or path
        JSON files, in the order of the page.
    output : str or path
        The file; its folder is made if it does not exist. Its suffix decides: HTML (.html, .htm), or Markdown
        without pictures (.md).
    title : str
        Its title; by default the datasets'.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ValueError
        If there are none, a file is no result, the page would replace one, or has another suffix.
    """
    output = Path(output)
    if output.resolve() in [Path(path).resolve() for path in paths]:
        raise ValueError(f"{output} is one of the results. Expected another file name")
    check_suffix(output, ".html", ".htm", ".md")
    read = [(Path(path).name, read_document(path)) for path in paths]
    counts = Counter(document.title for _, document in read)
    documents = []
    for file, document in read:
        # Results of equal titles are told apart by their pipelines, or else by their files.
        distinction = document.subtitle.partition(":")[0] if document.data else file
        full_title = f"{document.title}: {distinction}" if counts[document.title] > 1 else document.title
        documents.append(replace(document, title=full_title, again={"File": file, **document.again}))
    names = list(dict.fromkeys(document.data[0] for document in documents if document.data))
    if not title:
        title = "Surfaces from what a tool felt" + (f": {', '.join(names)}" if 0 < len(names) <= 3 else "")
    with refusing_damage(", ".join(file for file, _ in read) or "no file"):
        if output.suffix.lower() == ".md":
            page = "\n".join(map(render_markdown, documents))
        else:
            page = render_page(documents, title, written_by="texclass report")
    write_atomic(output, page)
    return output
