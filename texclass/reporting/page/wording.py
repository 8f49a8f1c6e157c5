"""How numbers and protocols are written on the page."""

from collections.abc import Iterable, Mapping
from typing import Any

from texclass.reporting.words import title_of

MINUS = "\N{MINUS SIGN}"
PROTOCOLS = {
    "recording": "folds over recordings",
    "operator": "leave one operator out",
    "run": "folds over whole runs",
    "blocks": "first half of the repetitions to second half",
    "few-shot": "three repetitions to second half",
    "paper": "the paper's protocol",
}
__all__ = ["MINUS", "digits", "interval", "p_value", "percent", "points", "protocol", "size", "title_of"]


def percent(fraction: float) -> str:
    """Return a fraction as per cents, without the sign."""
    return f"{100 * fraction:.1f}"


def interval(found: Mapping[str, Any]) -> str:
    """Return the interval of an accuracy in per cents."""
    return f"[{percent(found['low'])}, {percent(found['high'])}]"


def points(difference: float) -> str:
    """Return a difference of fractions in points, with its sign."""
    return f"{100 * difference:+.1f}".replace("-", MINUS)


def points_interval(found: Mapping[str, Any]) -> str:
    """Return the interval of a difference in points."""
    return f"[{points(found['low'])}, {points(found['high'])}]"


def digits(value: float | None) -> str:
    """Return a number to three digits; nothing for None."""
    if value is None:
        return ""
    shown = f"{value:.3g}"
    return (f"{value:,.0f}" if "e" in shown and abs(value) >= 1000 else shown).replace("-", MINUS)


def column(values: Iterable[float | None]) -> list[str]:
    """Return the numbers of a column with as many decimals each, so that their points stand in line."""
    values = list(values)
    largest = max((abs(value) for value in values if value is not None), default=0.0)
    decimals = 2 if largest < 100 else 1 if largest < 1000 else 0
    return ["" if value is None else f"{value:,.{decimals}f}".replace("-", MINUS) for value in values]


def p_value(p: float | None) -> str:
    """Return a p-value."""
    return "" if p is None else "< 0.001" if p < 0.001 else f"{p:.3f}"


def protocol(name: str) -> str:
    """Return a protocol in words."""
    return PROTOCOLS.get(name, name)


def size(facts: Mapping[str, Any]) -> str:
    """Return how many recordings of how many materials."""
    windows = f"{facts['n_windows']:,} windows of " if "n_windows" in facts else ""
    return f"{windows}{facts['n_recordings']:,} recordings of {facts['n_materials']} materials"


def sentence(text: str) -> str:
    """Return text that begins with a capital and ends with a stop."""
    text = text.strip()
    return text and text[0].upper() + text[1:] + ("" if text[-1] in ".!?" else ".")
