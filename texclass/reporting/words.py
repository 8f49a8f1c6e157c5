"""How names and rows of tables are written."""

CLASSIFIER_TITLES = {
    "naive_bayes": "Naive Bayes",
    "lda": "LDA",
    "shrinkage_lda": "Shrinkage LDA",
    "euclidean": "Euclidean",
    "nearest_neighbour": "Nearest neighbour",
}


def title_of(classifier: str) -> str:
    """Return the printed name of a classifier."""
    return CLASSIFIER_TITLES.get(classifier, classifier.replace("_", " ").capitalize())


def short_title_of(classifier: str) -> str:
    """Return the abbreviation of a classifier; its title if it has none."""
    return {"naive_bayes": "NB", "euclidean": "Eu"}.get(classifier, title_of(classifier))


def line_of(texts: tuple[str, ...]) -> str:
    """Return one row of a Markdown table."""
    return "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"
