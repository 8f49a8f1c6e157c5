"""What there is: the shipped dataset cards, and the features."""

import pandas as pd

from texclass import shipped
from texclass.document import Document, Table
from texclass.features.contract import Feature, registered
from texclass.features.sets import load_feature_set
from texclass.loaders import read_card
from texclass.loaders.cards import AnyCard, SimulatedCard
from texclass.loaders.places import DataNotFoundError, find_folder


def datasets_document() -> Document:
    """Return the shipped dataset cards: name, title, rate, and whether it is on this machine."""
    cards = [read_card(name) for name in shipped.names("datasets")]
    frame = pd.DataFrame(
        [(card.path.stem, card.title, _rate(card), _presence(card)) for card in cards],
        columns=["dataset", "what it is", "rate", "here"],
    )
    return Document("Shipped datasets", [Table(frame, n_words=4)])


def features_document(feature_set: str | None = None) -> Document:
    """Return every registered feature, or those of a set: phase, outputs, unit, gain law, source."""
    if feature_set is None:
        title = "All features"
        named = [
            (feature.name, feature, len(feature.columns(feature.name, {})))
            for feature in registered().values()
        ]
    else:
        members = load_feature_set(feature_set)
        title = f"Features of {members.name}"
        named = [(member.name, member.feature, len(member.columns)) for member in members.members]
    frame = pd.DataFrame(
        [
            (name, feature.phase, str(n_columns), feature.unit, f"{feature.summary}\n{_contract(feature)}\n")
            for name, feature, n_columns in named
        ],
        columns=["feature", "phase", "columns", "unit", "what it is"],
    )
    return Document(title, [Table(frame, n_words=5)])


def _contract(feature: Feature) -> str:
    """Say in one line where a feature comes from, how it scales, and what else moves it."""
    dependence = f"; depends on {' and '.join(sorted(feature.depends_on))}" if feature.depends_on else ""
    return f"{feature.reference}; signal x g: {feature.gain}{dependence}"


def _rate(card: AnyCard) -> str:
    return f"{card.recipe.fs if isinstance(card, SimulatedCard) else card.fs_hz:g} Hz"


def _presence(card: AnyCard) -> str:
    if card.format == "simulated":
        return "always"
    try:
        find_folder(card.folder, card_path=card.path, source=card.source)
    except DataNotFoundError:
        return "no"
    return "yes"
