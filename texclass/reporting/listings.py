"""Listings for the terminal: which datasets are known and at hand, which features there are."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from texclass import shipped
from texclass.features.contract import Feature, Gain, registered
from texclass.features.sets import load_feature_set
from texclass.loaders import read_card
from texclass.loaders.cards import AnyCard, SimulatedCard
from texclass.loaders.places import DataNotFoundError, find_folder

if TYPE_CHECKING:
    from rich.table import Table


def dataset_table() -> "Table":
    """Return the shipped dataset cards: name, title, rate, and whether it is on this machine."""
    cards = [read_card(name) for name in shipped.names("datasets")]
    return _table(
        ("dataset", "what it is", "rate", "here"),
        ((card.name, card.title, _rate(card), _presence(card)) for card in cards),
    )


def feature_table(feature_set: str | None = None) -> "Table":
    """Return every registered feature, or the features of a set: phase, outputs, unit, gain law, source."""
    if feature_set is None:
        named: list[tuple[str, Feature, int]] = [
            (f.name, f, len(f.columns(f.name, {}))) for f in registered().values()
        ]
    else:
        members = load_feature_set(feature_set).members
        named = [(member.name, member.feature, len(member.columns)) for member in members]
    return _table(
        ("feature", "phase", "columns", "unit", "what it is"),
        (
            (name, feature.phase, str(n_columns), feature.unit, f"{feature.summary}\n{_contract(feature)}\n")
            for name, feature, n_columns in named
        ),
    )


def _contract(feature: Feature) -> str:
    """Say in one line where a feature comes from, how it scales, and what else moves it."""
    dependence = f"; depends on {' and '.join(sorted(feature.depends_on))}" if feature.depends_on else ""
    return f"{feature.reference}; signal x g: {_gain_law(feature.gain)}{dependence}"


def _table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> "Table":
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for i, title in enumerate(header):
        table.add_column(title, overflow="fold", no_wrap=i == 0)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    return table


def _rate(card: AnyCard) -> str:
    return f"{card.recipe.fs if isinstance(card, SimulatedCard) else card.fs_hz:g} Hz"


def _presence(card: AnyCard) -> str:
    if isinstance(card, SimulatedCard):
        return "always"
    try:
        find_folder(card.folder, card_path=card.path, source=card.source)
    except DataNotFoundError:
        return "no"
    return "yes"


def _gain_law(gain: Gain) -> str:
    """Say what becomes of y when the signal is multiplied by g."""
    if gain == Gain():
        return "y"
    scaled = "y" if gain.power == 0 else f"y g^{gain.power:g}".removesuffix("^1")
    return scaled if gain.shift == 0 else f"{scaled} + {gain.shift:g} log10 g".replace(" 1 log10", " log10")
