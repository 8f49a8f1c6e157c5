"""Reasons why features are undefined. Commands that extract features do not load scikit-learn for them."""

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from texclass.reporting.wording import counted

if TYPE_CHECKING:
    import pandas as pd


class Reason(NamedTuple):
    """Reason why a feature is undefined for a recording."""

    recording_id: str
    feature: str
    reason: str


def describe_missing_values(values: "pd.DataFrame", reasons: Iterable[Reason]) -> str:
    """Describe how many columns are undefined in all or in some recordings, and the most frequent reasons."""
    is_missing = values.isna()
    n_empty, n_incomplete = int(is_missing.all().sum()), int(is_missing.any().sum())
    text = f"{n_empty} of {counted(len(values.columns), 'column')} without any value"
    text += f", {n_incomplete - n_empty} with some missing" if n_incomplete > n_empty else ""
    frequent = Counter(reason.reason for reason in reasons).most_common(3)
    return text + (f": {' / '.join(reason for reason, _ in frequent)}" if n_incomplete else "")
