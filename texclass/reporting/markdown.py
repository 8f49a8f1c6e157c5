"""Documents as Markdown, with figures as PNG files in the same folder."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from texclass.atomic_write import write_atomic
from texclass.reporting.blocks import Block, Details, Document, Figure, Heading, HeatMap, Table
from texclass.reporting.figure_style import draw_block, save_figure
from texclass.reporting.wording import cell_texts, column_titles, split_interval


def write_document(
    document: Document, folder: str | Path, stem: str, *, json: str = "", pictures: bool = True
) -> tuple[Path, ...]:
    """Write a document as Markdown and PNG files into a folder.

    Parameters
    ----------
    document : Document
        Document to write.
    folder : str or path
        Output folder; created if it does not exist.
    stem : str
        Prefix of the file names: `stem.md`, and `stem-NAME.png` for each figure.
    json : str
        JSON text of the result, which is written to `stem.json` (default: no JSON file).
    pictures : bool
        Whether to draw the figures (default True). If False, the text contains only their summaries.

    Returns
    -------
    tuple of Path
        Paths of the written files.

    Examples
    --------
    >>> import tempfile
    >>> from texclass.reporting import Document
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     (path,) = write_document(Document("Latency", ["Below 1 ms."]), folder, "latency")
    ...     print(path.name)
    latency.md
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"json": json, "md": render_markdown(document, stem if pictures else None)}
    written = [folder / f"{stem}.{suffix}" for suffix, text in texts.items() if text]
    for path in written:
        write_atomic(path, texts[path.suffix[1:]])
    for block in document.blocks if pictures else ():
        if isinstance(block, Figure | HeatMap):
            written.append(folder / f"{stem}-{block.name}.png")
            save_figure(draw_block(block), written[-1], title=f"{document.title}: {block.title}")
    return tuple(written)


def render_markdown(document: Document, stem: str | None = None) -> str:
    """Return a document as Markdown.

    Parameters
    ----------
    document : Document
        Document to render.
    stem : str, optional
        Prefix of the names of the figure files, as in `write_document`. By default, the text contains only
        the summaries of the figures.

    Examples
    --------
    >>> from texclass.reporting import Document
    >>> print(render_markdown(Document("Latency", [["Measured on one core."]])))
    # Latency
    <BLANKLINE>
    - Measured on one core.
    <BLANKLINE>
    """
    lines = [f"# {document.title}", ""]
    if document.subtitle:
        lines += [document.subtitle, ""]
    if finding := document.finding:
        lines += [f"**{finding.number}** {finding.rest}", ""]
    for block in document.blocks:
        lines += [*_block(block, stem), ""]
    if document.dataset:
        name, facts = document.dataset
        lines += [f"## Dataset {name}", "", *_list(facts), ""]
    if document.reproduction:
        lines += ["## To reproduce", "", *_list(document.reproduction)]
        if document.versions:
            lines.append("- Versions: " + ", ".join(f"{n} {v}" for n, v in document.versions.items()))
        lines.append("")
    return "\n".join(lines).rstrip("\n") + "\n"


def _block(block: Block, stem: str | None, level: str = "##") -> Iterator[str]:
    match block:
        case Heading():
            yield f"{level} {block}"
        case str():
            yield block
        case Table():
            yield from _table(block)
        case Figure() | HeatMap():
            if stem is not None:
                yield from (f"![{block.title}]({stem}-{block.name}.png)", "")
            yield f"{block.title}: {block.summary}"
        case Details():
            yield f"### {block.title}"
            for inner in block.blocks:
                yield from ("", *_block(inner, stem, "####"))
        case Mapping():
            yield from _list(block)
        case _:
            yield from (f"- {note}" for note in block)


def _list(facts: Mapping[str, str]) -> Iterator[str]:
    return (f"- {name}: {value}" for name, value in facts.items())


def _table(table: Table) -> Iterator[str]:
    yield _line([" ".join(filter(None, title)) for title in column_titles(table.frame)])
    n_columns = len(column_titles(table.frame))
    yield "|" + "---|" * table.n_words + "---:|" * (n_columns - table.n_words)
    for i, row in enumerate(cell_texts(table.frame)):
        if i in table.messages:
            yield _line([row[0], table.messages[i], *[""] * (n_columns - 2)])
        elif i in table.bold_rows:
            pairs = (split_interval(text) for text in row)
            yield _line([f"**{number}** {rest}".strip() if number else rest for number, rest in pairs])
        else:
            yield _line(row)
    if table.caption:
        yield from ("", table.caption)


def _line(texts: list[str]) -> str:
    return "| " + " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in texts) + " |"
