"""A document as Markdown, with its pictures as files beside it."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from texclass.atomic_write import write_atomic
from texclass.reporting.blocks import Block, Document, Figure, Folded, Heading, Heat, Table
from texclass.reporting.figure_style import drawn, save_figure
from texclass.reporting.wording import split_interval, texts_of, titles_of


def write_document(
    document: Document, folder: str | Path, stem: str, *, json: str = "", pictures: bool = True
) -> tuple[Path, ...]:
    """Write a document into a folder.

    Parameters
    ----------
    document : Document
        What is written.
    folder : str or path
        Made if it does not exist.
    stem : str
        Begins the names: `stem.md`, and `stem-NAME.png` for each figure.
    json : str
        The result as JSON text, written into `stem.json`; none by default.
    pictures : bool
        Whether figures are drawn; else their sentences stand in the text.

    Returns
    -------
    tuple of Path
        The files.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"json": json, "md": render_markdown(document, stem if pictures else None)}
    written = [folder / f"{stem}.{suffix}" for suffix, text in texts.items() if text]
    for path in written:
        write_atomic(path, texts[path.suffix[1:]])
    for block in document.blocks if pictures else ():
        if isinstance(block, Figure | Heat):
            written.append(folder / f"{stem}-{block.name}.png")
            save_figure(drawn(block), written[-1], title=f"{document.title}: {block.title}")
    return tuple(written)


def render_markdown(document: Document, stem: str | None = None) -> str:
    """Return a document as Markdown.

    Parameters
    ----------
    document : Document
        What is told.
    stem : str, optional
        Begins the names of its pictures, as in `write_document`; without it only their sentences are told.
    """
    lines = [f"# {document.title}", ""]
    if document.subtitle:
        lines += [document.subtitle, ""]
    if found := document.finding:
        lines += [f"**{found.number}** {found.rest}", ""]
    for block in document.blocks:
        lines += [*_block(block, stem), ""]
    if document.data:
        name, facts = document.data
        lines += [f"## Dataset {name}", "", *_list(facts), ""]
    if document.again:
        lines += ["## To compute it again", "", *_list(document.again)]
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
        case Figure() | Heat():
            if stem is not None:
                yield from (f"![{block.title}]({stem}-{block.name}.png)", "")
            yield f"{block.title}: {block.says}"
        case Folded():
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
    yield _line([" ".join(filter(None, title)) for title in titles_of(table.frame)])
    n_columns = len(titles_of(table.frame))
    yield "|" + "---|" * table.n_words + "---:|" * (n_columns - table.n_words)
    for i, row in enumerate(texts_of(table.frame)):
        if i in table.instead:
            yield _line([row[0], table.instead[i], *[""] * (n_columns - 2)])
        elif i in table.strong:
            parted = (split_interval(text) for text in row)
            yield _line([f"**{number}** {beside}".strip() if number else beside for number, beside in parted])
        else:
            yield _line(row)
    if table.caption:
        yield from ("", table.caption)


def _line(texts: list[str]) -> str:
    return "| " + " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in texts) + " |"
