"""Tables of the shipped dataset cards and of the features."""

import pandas as pd

from texclass import shipped
from texclass.features.contract import list_features
from texclass.features.sets import load_feature_set
from texclass.loaders import read_card
from texclass.loaders.cards import SimulatedCard
from texclass.loaders.places import DataNotFoundError, find_folder
from texclass.reporting import Document, Table
from texclass.signals import HAND_WINDOW_S


def datasets_document() -> Document:
    """Return a table of the shipped dataset cards: name, title, sampling rate and availability."""
    rows = []
    for card in map(read_card, shipped.names("datasets")):
        if isinstance(card, SimulatedCard):
            fs, available = card.recipe.fs, "simulated"
        else:
            fs, available = card.fs_hz, "yes"
            try:
                find_folder(card)
            except DataNotFoundError:
                available = "download" if card.download else "no"
        rows.append((card.path.stem, card.title, f"{fs:g} Hz", available))
    frame = pd.DataFrame(rows, columns=["dataset", "title", "rate", "available"])
    return Document("Shipped datasets", [Table(frame, n_words=4)])


def features_document(feature_set: str | None = None) -> Document:
    """Return a table of all features, or of one set: phase, columns, unit, description."""
    if feature_set is None:
        title, notes = "All features", []
        columns = {name: (feature, feature.columns(name, {})) for name, feature in list_features().items()}
    else:
        members = load_feature_set(feature_set)
        title = f"Features of {members.name}"
        conditioning = "Conditioning of movements: mean removed"
        if members.remove_hand_motion:
            conditioning += (
                f"; for recordings in m/s^2 with gravity, a moving average over {HAND_WINDOW_S:g} s removed"
            )
        notes = [f"{members.description}. {conditioning}."]
        columns = {member.name: (member.feature, member.columns) for member in members.members}
    rows = []
    for name, (feature, names) in columns.items():
        contract = f"{feature.reference}; signal x g: {feature.gain}"
        if feature.depends_on:
            contract += f"; depends on {' and '.join(sorted(feature.depends_on))}"
        rows.append((name, feature.phase, str(len(names)), feature.unit, f"{feature.summary}\n{contract}\n"))
    frame = pd.DataFrame(rows, columns=["feature", "phase", "columns", "unit", "description"])
    return Document(title, [*notes, Table(frame, n_words=5)])
