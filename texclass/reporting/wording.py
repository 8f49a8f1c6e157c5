"""How numbers are written wherever results are told."""

import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

MINUS = "\N{MINUS SIGN}"


def counted(n: int, noun: str) -> str:
    """Return how many there are of a thing: 1 tap, 1,200 taps."""
    return f"{n:,} {noun}" if n == 1 else f"{n:,} {noun}s"


def percent(fraction: float) -> str:
    """Return a fraction as per cents, without the sign."""
    return f"{100 * fraction:.1f}"


def interval(found: Mapping[str, Any]) -> str:
    """Return `low` and `high`, fractions, in per cents and brackets."""
    return f"[{percent(found['low'])}, {percent(found['high'])}]"


def estimate(found: Mapping[str, Any]) -> str:
    """Return `mean`, `low` and `high`, fractions, in per cents: 90.0 [82.6, 94.5]."""
    return f"{percent(found['mean'])} {interval(found)}"


def points(difference: float) -> str:
    """Return a difference of fractions in points, with its sign."""
    return f"{100 * difference:+.1f}".replace("-", MINUS)


def gain(found: Mapping[str, Any]) -> str:
    """Return `difference`, `low` and `high`, fractions, in points."""
    return f"{points(found['difference'])} {points_interval(found)}"


def points_interval(found: Mapping[str, Any]) -> str:
    """Return `low` and `high`, differences of fractions, in points and brackets."""
    return f"[{points(found['low'])}, {points(found['high'])}]"


def p_value(p: float | None) -> str:
    """Return a p-value; nothing for None."""
    return "" if p is None else "< 0.001" if p < 0.001 else f"{p:.3f}"


def digits(value: float | None) -> str:
    """Return a number to three digits; nothing for None."""
    if value is None or _is_missing(value):
        return ""
    shown = f"{value:.3g}"
    return (f"{value:,.0f}" if "e" in shown and abs(value) >= 1000 else shown).replace("-", MINUS)


def aligned(values: Iterable[float | None]) -> list[str]:
    """Return the numbers of a column with as many decimals each, so that their points stand in line."""
    values = list(values)
    largest = max((abs(value) for value in values if value is not None), default=0.0)
    decimals = 2 if largest < 100 else 1 if largest < 1000 else 0
    return ["" if value is None else f"{value:,.{decimals}f}".replace("-", MINUS) for value in values]


def sentence(text: str) -> str:
    """Return text that begins with a capital and ends with a stop."""
    text = text.strip()
    return text and text[0].upper() + text[1:] + ("" if text[-1] in ".!?" else ".")


def texts_of(frame: "pd.DataFrame | Mapping[str, Sequence[Any]]") -> list[list[str]]:
    """Return the cells of a table as texts: numbers to three digits, nothing for what is missing."""
    if isinstance(frame, Mapping):
        return [[_text(value) for value in row] for row in zip(*frame.values(), strict=True)]
    return [[_text(value) for value in row] for row in frame.itertuples(index=False, name=None)]


def titles_of(frame: "pd.DataFrame | Mapping[str, Sequence[Any]]") -> list[tuple[str, str]]:
    """Return the title of each column: of a group and of its part, or a single one and nothing."""
    titles: list[Any] = list(frame if isinstance(frame, Mapping) else frame.columns)
    return [title if isinstance(title, tuple) else (title, "") for title in titles]


def split_interval(text: str) -> tuple[str, str]:
    """Return a number and the interval in brackets behind it, without which a text is a number alone."""
    number, bracket, rest = text.partition(" [")
    return number, f"[{rest}" if bracket else ""


def _is_missing(value: Any) -> bool:
    """Whether there is no value: None, NaN, or what pandas has for it in columns of other kinds."""
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
