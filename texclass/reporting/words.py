"""How rows of Markdown tables are written in the reproductions."""


def line_of(texts: tuple[str, ...]) -> str:
    """Return one row of a Markdown table."""
    return "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"
