"""Write report pages of saved results, and find stale results."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from texclass.atomic_write import check_suffix, write_atomic

# Importing these modules registers the kinds of results.
from texclass.baselines import comparison  # noqa: F401
from texclass.cli import invariance_document  # noqa: F401
from texclass.evaluation import new_feature  # noqa: F401
from texclass.evaluation.pipeline import load_pipeline
from texclass.evaluation.result_comparison import ResultComparison, compare_results
from texclass.evaluation.result_facts import CODE_DEPENDENCIES
from texclass.features.sets import load_feature_set
from texclass.leaderboard import leaderboard  # noqa: F401
from texclass.provenance import code_hash
from texclass.recognition.live import stream_score  # noqa: F401
from texclass.reporting import Document, render_markdown, render_page
from texclass.reporting.result_files import Result, read_result
from texclass.stability import battery  # noqa: F401
from texclass.tradeoff import study  # noqa: F401


def read_document(path: str | Path) -> Document:
    """Read the JSON file of a result and return its report as a document.

    Parameters
    ----------
    path : str or path
        JSON file written by a command.

    Raises
    ------
    ValueError
        If the file is not a result, or is damaged.
    OSError
        If the file cannot be read.
    """
    result = read_result(path, _parse_number)
    with damage_as_value_error(str(path)):
        return result.document()


def _parse_number(text: str) -> float:
    """Parse a number in the JSON of a result; raise an error if it is too large to be plotted."""
    if not abs(float(text)) <= 1e100:
        raise ValueError(f"numbers must be at most 1e100 in magnitude, got {text:.40}")
    return int(text) if text.removeprefix("-").isdigit() else float(text)


@contextmanager
def damage_as_value_error(files: str, *other: type[Exception]) -> Iterator[None]:
    """Convert errors that damaged results raise, except `other`, to a ValueError that names the files."""
    try:
        yield
    except other:
        raise
    except (ValueError, TypeError, LookupError, ArithmeticError, AttributeError) as error:
        raise ValueError(
            f"{files}: the result is damaged ({type(error).__name__}: {error}). Run the command that "
            "wrote it again"
        ) from error


def stale_results(paths: Sequence[str | Path]) -> tuple[dict[Path, str], dict[Path, str]]:
    """Find stale results: their code, pipeline or features have changed since they were computed.

    Changes in comments, docstrings and report modules are ignored.

    Parameters
    ----------
    paths : sequence of str or path
        JSON files.

    Returns
    -------
    stale : dict of Path to str
        Reason why each stale result is out of date.
    skipped : dict of Path to str
        Reason why each skipped path is not a result, such as a folder.

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
            with damage_as_value_error(str(path)):
                reasons = [*_changed_code(result), *_changed_definitions(result)]
        except ValueError as error:
            skipped[path] = str(error).removeprefix(f"{path}: ")
            continue
        if reasons:
            stale[path] = "; ".join(reasons)
    return stale, skipped


_hash_of_code = cache(partial(code_hash, words=False))


def _changed_code(result: Result) -> Iterator[str]:
    """Yield the reason why the result is stale, if its code has changed."""
    if not result.data.get("code_hash"):
        yield "contains no hash of its code"
        return
    places = result.data.get("code_of", CODE_DEPENDENCIES)
    if invalid := [place for place in places if not place.isidentifier()]:
        raise ValueError(f"code_of must list subpackages and modules of texclass, got {invalid[0]!r}")
    try:
        is_same = result.data["code_hash"] == _hash_of_code(*places)
    except ValueError:  # a subpackage that no longer exists
        is_same = False
    if not is_same:
        yield "its code has changed"


def _changed_definitions(result: Result) -> Iterator[str]:
    """Yield one reason why the result is stale for each changed pipeline and feature set."""
    loaders: dict[str, Callable[[str], Any]] = {"pipeline": load_pipeline, "feature set": load_feature_set}
    for kind, (name, digest) in result.definitions.items():
        if name and digest:
            try:
                if loaders[kind](name).hash != digest:
                    yield f"{kind} {name} has changed"
            except (ValueError, OSError):
                yield f"{kind} {name} does not exist"


def compare_files(first: Path, second: Path) -> ResultComparison:
    """Read and compare two results; `compare_results` describes the errors."""
    results = [read_result(path, _parse_number) for path in (first, second)]
    with damage_as_value_error(f"{first}, {second}", ValueError):
        comparison = compare_results(*results, names=(str(first), str(second)))
        comparison.document()
    return comparison


def write_document_page(document: Document, output: Path, title: str = "") -> Path:
    """Write one document as self-contained HTML, or as Markdown if the suffix is .md."""
    if output.suffix.lower() == ".md":
        write_atomic(output, render_markdown(document))
    else:
        write_atomic(output, render_page([document], title or document.title, written_by="texclass report"))
    return output


def write_page(paths: Sequence[str | Path], output: str | Path, title: str = "") -> Path:
    """Write one report page for several results, as self-contained HTML or as Markdown.

    Parameters
    ----------
    paths : sequence of str or path
        JSON files, in the order in which the page lists them.
    output : str or path
        Page to write: HTML (.html, .htm), or Markdown without figures (.md). Missing folders are created.
    title : str
        Title of the page (default: the names of the datasets).

    Returns
    -------
    Path
        Path of the page.

    Raises
    ------
    ValueError
        If a file is not a result, the page would overwrite a result, or its suffix is invalid.
    """
    output = Path(output)
    if output.resolve() in [Path(path).resolve() for path in paths]:
        raise ValueError(
            f"cannot write the page to {output}: it is one of the results. Choose another file with --output"
        )
    check_suffix(output, ".html", ".htm", ".md")
    results = [(Path(path).name, read_document(path)) for path in paths]
    counts = Counter(document.title for _, document in results)
    documents = []
    for file, document in results:
        # Results with equal titles are distinguished by pipeline, or by file.
        distinction = document.subtitle.partition(":")[0] if document.dataset else file
        full_title = f"{document.title}: {distinction}" if counts[document.title] > 1 else document.title
        documents.append(
            replace(document, title=full_title, reproduction={"File": file, **document.reproduction})
        )
    names = list(dict.fromkeys(document.dataset[0] for document in documents if document.dataset))
    if not title:
        title = "Surface classification" + (f": {', '.join(names)}" if 0 < len(names) <= 3 else "")
    with damage_as_value_error(", ".join(file for file, _ in results) or "no file"):
        if output.suffix.lower() == ".md":
            page = "\n".join(map(render_markdown, documents))
        else:
            page = render_page(documents, title, written_by="texclass report")
    write_atomic(output, page)
    return output
