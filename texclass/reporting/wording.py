"""Number formats of reports: percentages, intervals, p-values, aligned columns."""

import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

MINUS = "\N{MINUS SIGN}"


def counted(n: int, noun: str) -> str:
    """Return a number with its noun in the singular or plural, for example "1 tap" or "1,200 taps"."""
    return f"{n:,} {noun}" if n == 1 else f"{n:,} {noun}s"


def percent(fraction: float) -> str:
    """Return a fraction in per cent without the % sign, for example "90.0" for 0.9."""
    return f"{100 * fraction:.1f}"


def interval(accuracy: Mapping[str, Any]) -> str:
    """Return the interval of an accuracy (`low` and `high`, fractions) in per cent: [82.6, 94.5]."""
    return f"[{percent(accuracy['low'])}, {percent(accuracy['high'])}]"


def estimate(accuracy: Mapping[str, Any]) -> str:
    """Return an accuracy (`mean`, `low` and `high`, fractions) in per cent: 90.0 [82.6, 94.5]."""
    return f"{percent(accuracy['mean'])} {interval(accuracy)}"


def points(difference: float) -> str:
    """Return a difference of fractions in percentage points, with its sign, for example "+4.0" for 0.04."""
    return f"{100 * difference:+.1f}".replace("-", MINUS)


def gain(comparison: Mapping[str, Any]) -> str:
    """Return a comparison (`difference`, `low` and `high`, fractions) in points: +4.0 [-3.4, +8.5]."""
    return f"{points(comparison['difference'])} {points_interval(comparison)}"


def points_interval(comparison: Mapping[str, Any]) -> str:
    """Return the interval of a comparison (`low` and `high`, fractions) in points: [-3.4, +8.5]."""
    return f"[{points(comparison['low'])}, {points(comparison['high'])}]"


def p_value(p: float | None) -> str:
    """Return a p-value with three decimals, or "" for None."""
    return "" if p is None else "< 0.001" if p < 0.001 else f"{p:.3f}"


def digits(value: float | None) -> str:
    """Return a number with three significant digits, or "" for None."""
    if value is None or _is_missing(value):
        return ""
    text = f"{value:.3g}"
    return (f"{value:,.0f}" if "e" in text and abs(value) >= 1000 else text).replace("-", MINUS)


def aligned(values: Iterable[float | None]) -> list[str]:
    """Return the numbers of a column as text with equal numbers of decimals; None becomes ""."""
    values = list(values)
    largest = max((abs(value) for value in values if value is not None), default=0.0)
    decimals = 2 if largest < 100 else 1 if largest < 1000 else 0
    return ["" if value is None else f"{value:,.{decimals}f}".replace("-", MINUS) for value in values]


def sentence(text: str) -> str:
    """Return text as a sentence that starts with a capital letter and ends with a full stop."""
    text = text.strip()
    return text and text[0].upper() + text[1:] + ("" if text[-1] in ".!?" else ".")


def cell_texts(frame: "pd.DataFrame | Mapping[str, Sequence[Any]]") -> list[list[str]]:
    """Return the cells of a table as rows of strings. Numbers get three digits; missing values become ""."""
    if isinstance(frame, Mapping):
        return [[_text(value) for value in row] for row in zip(*frame.values(), strict=True)]
    return [[_text(value) for value in row] for row in frame.itertuples(index=False, name=None)]


def column_titles(frame: "pd.DataFrame | Mapping[str, Sequence[Any]]") -> list[tuple[str, str]]:
    """Return (group, title) for each grouped column, and (title, "") for each ungrouped column."""
    titles: list[Any] = list(frame if isinstance(frame, Mapping) else frame.columns)
    return [title if isinstance(title, tuple) else (title, "") for title in titles]


def split_interval(text: str) -> tuple[str, str]:
    """Split "90.0 [82.6, 94.5]" into the number and its interval ("" if there is no interval)."""
    number, bracket, rest = text.partition(" [")
    return number, f"[{rest}" if bracket else ""


def _is_missing(value: Any) -> bool:
    """Return whether a value is None, NaN, or a pandas missing value (NA, NaT)."""
    if isinstance(value, float):
        return math.isnan(value)
    return value is None or type(value).__name__ in ("NAType", "NaTType")


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if _is_missing(value):
        return ""
    if isinstance(value, float):
        return digits(value)
    return f"{value:,}" if isinstance(value, numbers.Number) else str(value)
