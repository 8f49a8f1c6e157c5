"""What there is: the shipped dataset cards, and the features."""

import pandas as pd

from texclass import shipped
from texclass.features.contract import registered
from texclass.features.sets import load_feature_set
from texclass.loaders import read_card
from texclass.loaders.cards import SimulatedCard
from texclass.loaders.places import DataNotFoundError, find_folder
from texclass.reporting import Document, Table
from texclass.signals import HAND_SPAN_S


def datasets_document() -> Document:
    """Return the shipped dataset cards: name, title, rate, and whether it is on this machine."""
    rows = []
    for card in map(read_card, shipped.names("datasets")):
        if isinstance(card, SimulatedCard):
            fs, here = card.recipe.fs, "always"
        else:
            fs, here = card.fs_hz, "yes"
            try:
                find_folder(card)
            except DataNotFoundError:
                here = "can be fetched" if card.published else "no"
        rows.append((card.path.stem, card.title, f"{fs:g} Hz", here))
    frame = pd.DataFrame(rows, columns=["dataset", "what it is", "rate", "here"])
    return Document("Shipped datasets", [Table(frame, n_words=4)])


def features_document(feature_set: str | None = None) -> Document:
    """Return every registered feature, or those of a set: phase, outputs, unit, gain law, source."""
    if feature_set is None:
        title, said = "All features", []
        named = [
            (feature.name, feature, len(feature.columns(feature.name, {})))
            for feature in registered().values()
        ]
    else:
        members = load_feature_set(feature_set)
        title = f"Features of {members.name}"
        named = [(member.name, member.feature, len(member.columns)) for member in members.members]
        hand = f"; where gravity is felt in m/s^2, less what a moving average over {HAND_SPAN_S:g} s holds"
        said = [f"{members.description}. Movements: mean removed{hand if members.without_hand else ''}."]
    rows = []
    for name, feature, n_columns in named:
        # Where it comes from, how it scales, and what else moves it.
        contract = f"{feature.reference}; signal x g: {feature.gain}"
        if feature.depends_on:
            contract += f"; depends on {' and '.join(sorted(feature.depends_on))}"
        told = f"{feature.summary}\n{contract}\n"
        rows.append((name, feature.phase, str(n_columns), feature.unit, told))
    frame = pd.DataFrame(rows, columns=["feature", "phase", "columns", "unit", "what it is"])
    return Document(title, [*said, Table(frame, n_words=5)])
