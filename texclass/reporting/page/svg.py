"""Pictures as inline SVG that fits any width: places along x are per cents, so text is never stretched."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from texclass.reporting.page.scales import Scale

NOTHING = Markup("")
HEIGHT = 260
ROW = 30
LONGEST = 54
"""Characters of a row's name in the picture; the table has all of it."""
SHAPES = {
    "disc": "M-4.5,0A4.5,4.5 0 1 0 4.5,0A4.5,4.5 0 1 0 -4.5,0Z",
    "square": "M-4,-4H4V4H-4Z",
    "diamond": "M0,-5.5L5.5,0L0,5.5L-5.5,0Z",
    "triangle": "M0,-5.5L5.2,4.2H-5.2Z",
    "ring": "M-9,0A9,9 0 1 0 9,0A9,9 0 1 0 -9,0Z",
}


@dataclass(frozen=True)
class Picture:
    """What stands inside an `svg` element of full width, and its height in px; the page names it."""

    inner: Markup
    height: int


@dataclass(frozen=True)
class Point:
    """A value: where, its interval, and what it says."""

    x: float
    y: float
    says: str
    low: float | None = None
    high: float | None = None
    mark: str = ""


@dataclass(frozen=True)
class Series:
    """Points of one kind: `look` colours them; intervals are a band along a line, else whiskers."""

    look: str
    points: tuple[Point, ...]
    shape: str = "disc"
    line: bool = True
    band: bool = True


@dataclass(frozen=True)
class Spot:
    """A value in a row of `row_plot`: where, its interval along the row; a bar reaches from zero to it."""

    x: float
    look: str
    says: str
    low: float | None = None
    high: float | None = None
    shape: str = "disc"


def xy_plot(
    series: Sequence[Series],
    x: Scale,
    y: Scale,
    x_title: str,
    *,
    height: int = HEIGHT,
    level: tuple[float, str] | None = None,
    labels: Sequence[tuple[float, str]] = (),
    note: tuple[float, float, str] | None = None,
) -> Picture:
    """Draw points and lines.

    Parameters
    ----------
    series
        What is drawn.
    x, y
        The axes.
    x_title
        Title of x.
    height
        In px.
    level
        A line across, and what it means.
    labels
        Instead of the ticks of x.
    note
        (x, y, text): rings a point.
    """
    ticks = labels or [(tick, _tick(tick)) for tick in x.ticks]
    parts = [*_across(y, height), *_along(x, ticks, height, x_title)]
    if level is not None:
        at = _f((1 - y(level[0])) * height)
        parts.append(_el('<line class="level" x1="0" x2="100%" y1="{0}" y2="{0}"/>', at))
        parts.append(
            _el('<text class="small" x="100%" y="{}" dy="-5" text-anchor="end">{}</text>', at, level[1])
        )
    parts.append(_lines(series, x, y, height))
    parts += [_point(s, p, x, y, height) for s in series for p in s.points]
    if note is not None:
        place = (_p(x(note[0])), _f((1 - y(note[1])) * height))
        parts.append(
            _el(
                '<svg x="{}" y="{}" overflow="visible" aria-hidden="true"><path class="ring" d="{}"/></svg>',
                *place,
                SHAPES["ring"],
            )
        )
        anchor, dx = ("start", 4) if x(note[0]) < 0.5 else ("end", -4)
        parts.append(
            _el(
                '<text class="note" x="{}" y="{}" dx="{}" dy="26" text-anchor="{}">{}</text>',
                *place,
                dx,
                anchor,
                note[2],
            )
        )
    return Picture(Markup("\n").join(parts), height)


def row_plot(
    rows: Sequence[tuple[str, Sequence[Spot]]],
    x: Scale,
    x_title: str,
    *,
    bars: bool = False,
    zero: float | None = None,
) -> Picture:
    """Draw one row a name: dots with intervals, or bars from the low end; `zero` is a line down all rows."""
    height = ROW * len(rows) + 6
    parts = _along(x, [(tick, _tick(tick)) for tick in x.ticks], height, x_title)
    if zero is not None:
        parts.append(_el('<line class="zero" x1="{0}" x2="{0}" y1="0" y2="{1}"/>', _p(x(zero)), height))
    for i, (name, spots) in enumerate(rows):
        middle = ROW * i + ROW // 2 + 3
        parts.append(_el('<line class="row" x1="0" x2="100%" y1="{0}" y2="{0}"/>', middle))
        parts.append(_el('<text class="name" x="0" y="{}">{}</text>', middle, _short(name)))
        draw = _bar if bars else _spot
        parts += [draw(spot, x, middle, k, len(spots)) for k, spot in enumerate(spots)]
    return Picture(Markup("\n").join(parts), height)


def _across(y: Scale, height: int) -> list[Markup]:
    """Draw the grid of the vertical axis."""
    line = (
        '<line class="grid" x1="0" x2="100%" y1="{0}" y2="{0}"/>'
        '<text x="-8" y="{0}" dy="4" text-anchor="end">{1}</text>'
    )
    return [_el(line, _f((1 - y(tick)) * height), _tick(tick)) for tick in y.ticks]


def _along(x: Scale, ticks: Sequence[tuple[float, str]], height: int, title: str) -> list[Markup]:
    """Draw the grid of the horizontal axis, its labels and its title."""
    line = '<line class="grid" x1="{0}" x2="{0}" y1="0" y2="{1}"/>'
    text = '<text x="{}" y="{}" text-anchor="middle">{}</text>'
    parts = [_el(line, _p(x(at)), height) for at, _ in ticks]
    parts += [_el(text, _p(x(at)), height + 18, label) for at, label in ticks]
    return [
        *parts,
        _el('<text class="title" x="50%" y="{}" text-anchor="middle">{}</text>', height + 38, title),
    ]


def _lines(series: Sequence[Series], x: Scale, y: Scale, height: int) -> Markup:
    """Draw lines and bands in a picture of their own, which may be stretched: nothing in it has a width."""
    parts = []
    for s in series:
        if not s.line or len(s.points) < 2:
            continue
        places = [(100 * x(p.x), (1 - y(p.y)) * 100) for p in s.points]
        known = [p for p in s.points if s.band and p.low is not None and p.high is not None]
        band = [(100 * x(p.x), (1 - y(p.high or 0)) * 100) for p in known]
        band += [(100 * x(p.x), (1 - y(p.low or 0)) * 100) for p in reversed(known)]
        if band:
            parts.append(_el('<polygon class="band {}" points="{}"/>', s.look, _path(band)))
        parts.append(_el('<polyline class="line {}" points="{}"/>', s.look, _path(places)))
    shell = (
        '<svg viewBox="0 0 100 100" preserveAspectRatio="none" width="100%" height="{}" aria-hidden="true">'
    )
    return _el(shell, height) + NOTHING.join([*parts, Markup("</svg>")]) if parts else NOTHING


def _point(s: Series, p: Point, x: Scale, y: Scale, height: int) -> Markup:
    at = (1 - y(p.y)) * height
    whisker = NOTHING
    if p.low is not None and p.high is not None and not (s.line and len(s.points) > 1):
        ends = [_f((1 - y(end)) * height - at) for end in (p.high, p.low)]
        whisker = _el('<path class="whisker" d="M0,{}V{}"/>', *ends)
    mark = _mark(s.shape, p.mark)
    return _wrap(s.look, p.says, _p(x(p.x)), _f(at), whisker + mark)


def _spot(spot: Spot, x: Scale, middle: int, k: int, n: int) -> Markup:
    interval = NOTHING
    if spot.low is not None and spot.high is not None:
        line = '<line class="whisker" x1="{1}" x2="{2}" y1="{0}" y2="{0}"/>'
        interval = _el(line, middle, _p(x(spot.low)), _p(x(spot.high)))
    return _wrap(spot.look, spot.says, _p(x(spot.x)), str(middle), _mark(spot.shape, ""), interval)


def _bar(spot: Spot, x: Scale, middle: int, k: int, n: int) -> Markup:
    thick = 12 if k == 0 and n > 1 else 6
    rect = '<rect class="bar" x="0" width="{}" y="{}" height="{}"/>'
    return _group(spot.look, spot.says, _el(rect, _p(x(spot.x)), middle - thick // 2, thick))


def _mark(shape: str, text: str) -> Markup:
    if text:
        return _el(
            '<circle class="mark" r="10"/><text class="inside" dy="4" text-anchor="middle">{}</text>', text
        )
    return _el('<circle class="reach" r="11"/><path class="mark {}" d="{}"/>', shape, SHAPES[shape])


def _wrap(look: str, says: str, x: str, y: str, inner: Markup, below: Markup = NOTHING) -> Markup:
    shell = '<svg x="{}" y="{}" overflow="visible" aria-hidden="true">{}</svg>'
    return _group(look, says, below + _el(shell, x, y, inner))


def _group(look: str, says: str, inner: Markup) -> Markup:
    shell = '<g class="point {0}" role="img" aria-label="{1}"><title>{1}</title>{2}</g>'
    return _el(shell, look, says, inner)


def _short(name: str) -> str:
    """Return a name that fits beside its row."""
    return name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}\N{HORIZONTAL ELLIPSIS}"


def _el(template: str, *values: object) -> Markup:
    return Markup(template).format(*values)


def _path(places: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in places)


def _p(share: float) -> str:
    return f"{100 * share:.2f}%"


def _f(value: float) -> str:
    return f"{value:.1f}"


def _tick(value: float) -> str:
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")
