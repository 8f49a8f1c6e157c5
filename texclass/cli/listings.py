"""Tables of the shipped dataset cards, of one dataset, and of the features."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from texclass import shipped
from texclass.evaluation.protocols import find_protocol
from texclass.features.contract import list_features
from texclass.features.phase_view import Phase
from texclass.features.sets import load_feature_set
from texclass.loaders import open_dataset, read_card
from texclass.loaders.cards import CardError, SimulatedCard
from texclass.loaders.places import DataNotFoundError, find_folder
from texclass.reporting import Document, Heading, Table
from texclass.reporting.wording import counted
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


def dataset_document(name_or_path: str | Path) -> Document:
    """Return tables of the labels of a dataset and of the protocols that its card declares.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped card, or path of a card.

    Raises
    ------
    CardError
        If the card is invalid, or declares an unknown protocol.
    """
    card = read_card(name_or_path)
    protocols = []
    for one in card.protocols:
        try:
            protocol = find_protocol(one.protocol)
        except ValueError as error:
            raise CardError(f"{card.path}: protocols: {error}") from error
        windows = "" if one.window_s is None else f"{one.window_s:g} s"
        if one.max_windows:
            windows += f", first {one.max_windows}"
        folds = str(one.folds) if protocol.is_random else ""
        protocols.append((one.question, one.protocol, folds, windows, one.note))
    blocks: list[str | Heading | Table] = []
    try:
        dataset = open_dataset(name_or_path)
    except DataNotFoundError as error:
        blocks.append(f"{error}.")
    else:
        labels = {name: column.dropna().astype(str).unique() for name, column in dataset.table.items()}
        rows = [
            (str(name), str(len(values)), f"{', '.join(values[:6])}{', ...' if len(values) > 6 else ''}")
            for name, values in labels.items()
            if len(values)
        ]
        blocks += [f"{len(dataset)} recordings.", Heading("Labels")]
        blocks.append(Table(pd.DataFrame(rows, columns=["label", "values", "examples"]), n_words=3))
    if protocols:
        columns = ["question", "protocol", "folds", "windows", "note"]
        blocks += [Heading("Protocols"), Table(pd.DataFrame(protocols, columns=columns), n_words=5)]
    return Document(card.title, blocks)


def features_document(feature_sets: Sequence[str] = (), phase: Phase | None = None) -> Document:
    """Return a table of features: name, phase, number of columns and unit; description and reference.

    Parameters
    ----------
    feature_sets : sequence of str
        Names or files of feature sets (default: all features).
    phase : {"tap", "movement", "travel", "friction", "pair"}, optional
        Phase from which the features are computed (default: all phases).

    Raises
    ------
    ValueError
        If a feature set does not exist or is invalid.
    """
    sets = [load_feature_set(name) for name in feature_sets]
    notes = []
    for members in sets:
        conditioning = "Conditioning of movements: mean removed"
        if members.remove_hand_motion:
            conditioning += (
                f"; for recordings in m/s^2 with gravity, a moving average over {HAND_WINDOW_S:g} s removed"
            )
        name = f"{members.name}: " if len(sets) > 1 else ""
        notes.append(f"{name}{members.description}. {conditioning}.")
    if sets:
        features = dict.fromkeys(
            (one.name, one.feature, one.columns) for group in sets for one in group.members
        )
    else:
        all_features = list_features().items()
        features = dict.fromkeys((name, one, one.columns(name, {})) for name, one in all_features)
    rows = []
    for name, feature, columns in features:
        if phase not in (None, feature.phase):
            continue
        contract = f"{feature.reference}; signal x g: {feature.gain}"
        if feature.depends_on:
            contract += f"; depends on {' and '.join(sorted(feature.depends_on))}"
        facts = f"{name}\n{feature.phase}, {counted(len(columns), 'column')}\n{feature.unit}\n"
        rows.append((facts, f"{feature.summary}\n{contract}\n"))
    title = f"Features of {' and '.join(one.name for one in sets)}" if sets else "All features"
    if phase:
        title += f": {phase}"
    if not rows:
        return Document(title, [*notes, f"No feature is computed from the phase {phase!r}."])
    table = Table(pd.DataFrame(rows, columns=["feature", "description"]), n_words=2)
    return Document(title, [*notes, f"{counted(len(rows), 'feature')}.", table])
