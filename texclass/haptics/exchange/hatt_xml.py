"""Textures of the Penn Haptic Texture Toolkit (HaTT): read, made of textures of other families, written.

The layout, confirmed on the one hundred published textures at 1000 Hz and on the toolkit's own writer (its
MATLAB script that resamples models), stylesheet and C++ renderer, in public copies of the toolkit (the files:
github.com/Student-in-job/Penn_Toolkit; the original: repository.upenn.edu/meam_papers/299). Its licence is
for non-profit research and forbids passing it on: nothing of it is here; tests write files of their own.

    modelSet (texture="0")
      material, AccelUnits (m/s^2), SpeedUnits (mm/s), ForceUnits (N), SampleRate (Hz), mu,
      htmlPicture, htmlLinuxPicture, renderPicture,
      numMod, numTri, maxSpeed, maxForce,
      speedList, forceList (type="array"): value, one a model
      tri (type="array"), one a triangle: value x 3, models counted from 1
      DTpicture, LinuxDTpicture, numARCoeff, numMACoeff
      model: modNum, ARcoeff and MAcoeff: value (lag 0 first: 1), ARlsf and MAlsf: value (rad per sample),
             var, gain, speedMod, forceMod

What is rendered is y = -sum_i a_i y[t-i] + gain (e + sum_i c_i e[t-i]) with noise e of variance `var`; line
spectra, `var` and `gain` mix by barycentric coordinates. Where numMACoeff is 0 or missing, the toolkit takes
no gain. The published models have 14 to 20 AR coefficients, two fewer MA ones, nodes at rest of `var` 0, and
triangles that fill the rectangle from rest to maxSpeed and maxForce. The toolkit begins its search for the
triangle at the sixteenth.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.exchange.foreign import printable, read_limited
from texclass.haptics.textures import Texture
from texclass.haptics.textures.hatt import HattTexture, Mesh
from texclass.haptics.textures.oeztuerk2018 import LpcTexture
from texclass.haptics.textures.packed import PackedTexture
from texclass.recording import ACCELERATION_UNITS, Samples
from texclass.vibration import Autoregression, line_spectrum
from texclass.vibration.autoregressive import from_autocorrelation, from_direct_form

LARGEST_FILE = 8 << 20
"""Bytes; the published textures have 120,000."""
MOST_ELEMENTS, DEEPEST = 300_000, 16
MOST_MODELS = 10_000
_UNITS = {"AccelUnits": "m/s^2", "SpeedUnits": "mm/s", "ForceUnits": "N"}
_TOLERANCE = 2e-6
FS = 1000.0
"""What the toolkit renders at, Hz."""
ORDER = 20
"""Of the AR models in the published textures, about."""


def read_hatt(path: str | Path) -> HattTexture:
    """Return the texture of a HaTT file.

    The line spectra are those of ARlsf and MAlsf, which the toolkit renders; where they are rounded to six
    decimals, those of ARcoeff and MAcoeff, which they must agree with.

    Raises
    ------
    ValueError
        If it is not well formed, declares a document type (so that no entity is ever expanded), has wrong
        counts, units or triangles, NaN, or a model that is not stable (or an MA part not of minimum phase);
        the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    data = read_limited(path, LARGEST_FILE)
    parser = ElementTree.XMLParser(target=_BoundedTree(), encoding="utf-8")
    try:
        parser.feed(data)
        return _texture(parser.close())
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is not well formed ({error}). Expected XML in UTF-8") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


class _BoundedTree(ElementTree.TreeBuilder):
    """Stops a file that could grow in memory: with a document type, or with too many elements or levels."""

    def __init__(self) -> None:
        super().__init__()
        self._count = self._depth = 0

    def start(self, tag: str, attributes: dict[str, str]) -> Element:
        self._count, self._depth = self._count + 1, self._depth + 1
        if self._count > MOST_ELEMENTS or self._depth > DEEPEST:
            raise ValueError(f"has more than {MOST_ELEMENTS} elements or {DEEPEST} levels, the limits")
        return super().start(tag, {})

    def end(self, tag: str) -> Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, *_: str | None) -> None:
        raise ValueError(f"declares {name!r:.40}. Expected no document type and no entities")


def _texture(root: Element) -> HattTexture:
    if root.tag != "modelSet":
        raise ValueError(f"is a <{root.tag:.40}>. Expected <modelSet>")
    optional = _UNITS | {"material": "", "mu": "0", "numMACoeff": "0"}
    for tag, usual in optional.items():
        if root.find(tag) is None:
            ElementTree.SubElement(root, tag).text = usual
    for tag, unit in _UNITS.items():
        if (found := _text(root, tag)) != unit:
            raise ValueError(f"<{tag}> is {found!r:.40}. Expected {unit!r}")
    models, triangles = root.findall("model"), root.findall("tri")
    n, n_triangles = _count(root, "numMod"), _count(root, "numTri")
    speed, force = (_numbers(_child(root, tag), n) for tag in ("speedList", "forceList"))
    if not 0 < n <= MOST_MODELS or len(models) != n or len(triangles) != n_triangles:
        raise ValueError(
            f"holds {len(models)} models, {len(triangles)} triangles, numMod is {n}, numTri {n_triangles}. "
            f"Expected the same, 1 to {MOST_MODELS} models"
        )
    corners = np.array([_numbers(triangle, 3) for triangle in triangles]).reshape(-1, 3)
    # in the published files the models stand in the order of the lists
    places = {(_number(m, "speedMod"), _number(m, "forceMod")): m for m in models}
    points = list(zip(speed.tolist(), force.tolist(), strict=True))
    if len(places) != n or set(points) != set(places):
        raise ValueError(
            "the speeds and forces of the models are not those of speedList and forceList. "
            "Expected the same values, without duplicates"
        )
    p, q = _count(root, "numARCoeff"), _count(root, "numMACoeff")
    models = [places[point] for point in points]
    return HattTexture(
        Mesh(speed, force, corners - 1),
        ar_lsf=np.array([_frequencies(model, "AR", p) for model in models]),
        ma_lsf=np.array([_frequencies(model, "MA", q) for model in models]),
        variance=np.array([_number(model, "var") for model in models]),
        gain=np.array([_number(model, "gain") if q else 1.0 for model in models]),
        fs=_number(root, "SampleRate"),
        name=printable(_text(root, "material")),
        mu=_number(root, "mu"),
    )


def _frequencies(model: Element, part: str, order: int) -> Samples:
    """Return the line spectral frequencies (order,) of the AR or MA part of a model."""
    if not order:
        return np.zeros(0)
    given = {tag: _found(model, tag) for tag in (f"{part}lsf", f"{part}coeff")}
    try:
        lsf, coefficients = (
            None if element is None else _numbers(element, n)
            for element, n in zip(given.values(), (order, order + 1), strict=True)
        )
        if lsf is None and coefficients is None:
            raise ValueError(f"holds neither {part}coeff nor {part}lsf. Expected one of them")
        if coefficients is not None:
            exact = line_spectrum.from_reflection(from_direct_form(coefficients, 1.0).reflection)
            worst = 0.0 if lsf is None else float(np.abs(lsf - exact).max())
            if not worst <= _TOLERANCE:
                raise ValueError(
                    f"{part}coeff and {part}lsf are {worst:.3g} rad apart. Expected {_TOLERANCE}"
                )
            if lsf is None or np.array_equal(np.round(lsf, 6), lsf):
                return line_spectrum.spread(exact)
        if lsf is None or np.any(np.diff(lsf) < 0) or lsf[0] < 0 or lsf[-1] > math.pi:
            raise ValueError(
                f"{part}lsf is not rising in 0 ... pi. Expected rising line spectra: a stable model"
            )
        return line_spectrum.spread(lsf)
    except ValueError as error:
        raise ValueError(f"model {model.findtext('modNum', '?')!r:.20}: {part}: {error}") from error


def _found(element: Element, tag: str) -> Element | None:
    found = element.findall(tag)
    if len(found) > 1:
        raise ValueError(f"<{element.tag}> holds {len(found)} <{tag}>. Expected one")
    return found[0] if found else None


def _child(element: Element, tag: str) -> Element:
    if (found := _found(element, tag)) is None:
        raise ValueError(f"<{element.tag}> holds no <{tag}>. Expected one")
    return found


def _numbers(element: Element, n: int) -> Samples:
    values = [_parsed(value) for value in element.findall("value")]
    if len(values) != n or len(element) != n:
        raise ValueError(f"<{element.tag}> holds {len(element)} values. Expected {n}")
    return np.array(values)


def _number(element: Element, tag: str) -> float:
    return _parsed(_child(element, tag))


def _count(element: Element, tag: str) -> int:
    value = _number(element, tag)
    if not (value == int(value) and 0 <= value <= 1e6):
        raise ValueError(f"<{tag}> is {value:g}. Expected a count")
    return int(value)


def _text(element: Element, tag: str) -> str:
    return (_child(element, tag).text or "").strip()


def _parsed(element: Element) -> float:
    text = element.text or ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"<{element.tag}> holds {text!r:.40}. Expected a finite number")
    return value


def write_hatt(texture: HattTexture, path: str | Path) -> Path:
    """Write a texture as HaTT XML, numbers in full; a file of that name is replaced at once.

    The toolkit renders at 1000 Hz whatever SampleRate says: fit at that rate for it.

    Raises
    ------
    ValueError
        If the path does not end in `.xml`, the name cannot be shown, or an order is so high that coefficients
        no longer describe the model (ARcoeff belongs to the layout).
    """
    path = check_suffix(path, ".xml")
    root, mesh = Element("modelSet", texture="0"), texture.mesh
    image = f"{printable(texture.name)}_square.bmp"
    content: list[tuple[str, str | float | Samples]] = [
        ("material", texture.name),
        *_UNITS.items(),
        ("SampleRate", f"{texture.fs:.17g}"),
        ("mu", float(texture.mu)),
        *((tag, image) for tag in ("htmlPicture", "htmlLinuxPicture", "renderPicture")),
        ("numMod", mesh.speed.size),
        ("numTri", len(mesh.triangles)),
        ("maxSpeed", float(mesh.speed.max())),
        ("maxForce", float(mesh.force.max())),
        ("speedList", mesh.speed),
        ("forceList", mesh.force),
        *(("tri", corners) for corners in mesh.triangles + 1),
        ("DTpicture", ""),
        ("LinuxDTpicture", ""),
        ("numARCoeff", texture.order),
        ("numMACoeff", texture.ma_order),
    ]
    for tag, value in content:
        _add(root, tag, value, {"type": "array"})
    for i in range(mesh.speed.size):
        model = ElementTree.SubElement(root, "model")
        _add(model, "modNum", i + 1)
        for part, lsf in (("AR", texture.ar_lsf[i]), ("MA", texture.ma_lsf[i])):
            k = line_spectrum.to_reflection(lsf) if lsf.size else lsf
            _add(model, f"{part}coeff", Autoregression(k, np.array(1.0)).direct_form())
            _add(model, f"{part}lsf", lsf)
        # without an MA part the toolkit takes no gain
        gain, taken = float(texture.gain[i]), bool(texture.ma_order)
        _add(model, "var", float(texture.variance[i]) * (1.0 if taken else gain**2))
        _add(model, "gain", gain if taken else 1.0)
        _add(model, "speedMod", float(mesh.speed[i]))
        _add(model, "forceMod", float(mesh.force[i]))
    ElementTree.indent(root, "")
    text = ElementTree.tostring(root, encoding="unicode", short_empty_elements=False)
    write_atomic(path, f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'.encode())
    return path


def _add(
    parent: Element, tag: str, value: str | float | Samples, array: dict[str, str] | None = None
) -> None:
    """Append an element: text, a number, or the numbers of an array, each in a <value>."""
    if isinstance(value, np.ndarray):
        inside = ElementTree.SubElement(parent, tag, array or {})
        for each in value.tolist():
            _add(inside, "value", each)
    else:
        ElementTree.SubElement(parent, tag).text = value if isinstance(value, str) else repr(value)


def to_hatt(
    texture: Texture,
    *,
    unit: str = "m/s^2",
    speeds: Sequence[float] | None = None,
    forces: Sequence[float] | None = None,
    fs: float = FS,
    order: int = ORDER,
) -> HattTexture:
    """Return a texture as HaTT files hold it.

    A model of a higher order or rate is fitted anew to its own spectrum below fs / 2: what it says above is
    left out. Of an anisotropic texture, strokes along +x are taken. A texture that does not know force gets
    its models at 1 N: softer is fainter, harder is the same.

    Parameters
    ----------
    texture : Texture
        With AR models: hatt (kept but for the unit), all of abdulali2016, oeztuerk2018-lpc, packed.
    unit : str
        Of its vibration: m/s^2, g or mg.
    speeds, forces : sequence of float, optional
        Of the models, mm/s and N, above 0; by default evenly up to the fastest and the hardest of the texture
        (the speeds of an LPC texture as they are).
    fs : float
        Hz, at most the texture's.
    order : int
        Largest order of the models.

    Raises
    ------
    ValueError
        If the texture has no AR models, its rate is below `fs`, its unit has no known size, or a speed or a
        force is not above 0.
    """
    if unit not in ACCELERATION_UNITS:
        raise ValueError(f"unit is {unit!r}. Expected for HaTT one of {list(ACCELERATION_UNITS)}")
    factor = ACCELERATION_UNITS[unit]
    if isinstance(texture, HattTexture):
        return replace(texture, variance=texture.variance * factor**2)
    steps = np.arange(1, 7) / 6
    own: Sequence[Sequence[float] | Samples] = texture.speeds[-1] * steps, texture.forces[-1] * steps
    if isinstance(texture, LpcTexture):
        own = texture.speeds, texture.forces
    elif isinstance(texture, PackedTexture) and texture.speeds.size == 1:
        own = texture.model.axes  # slower and softer than these it fades out, above them nothing changes
    grid = [np.array(axis, dtype=np.float64) for axis in (speeds or own[0], forces or own[1])]
    if not all(np.all(np.isfinite(axis) & (axis > 0)) for axis in grid):
        raise ValueError(
            f"speeds are {grid[0].tolist()}, forces {grid[1].tolist()}. Expected a positive number"
        )
    if not 0 < fs <= texture.fs:
        raise ValueError(f"fs is {fs:g}. Expected at most that of the texture, {texture.fs:g} Hz")
    speed, force = (axis.ravel() for axis in np.meshgrid(*grid, indexing="ij"))
    model = texture.autoregressions(speed, force)
    if fs != texture.fs or model.order > order:
        # the autocorrelation of the spectrum below fs / 2: r_i = (1 / N) sum_n S(w_n) (fs / fs_0) e^{j i w_n}
        share = fs / texture.fs
        with np.errstate(under="ignore"):
            power = 10 ** (model.log_spectrum_db(np.linspace(0, np.pi, (1 << 14) + 1) * share) / 10) * share
        model = from_autocorrelation(np.fft.irfft(power, axis=-1)[..., : order + 1])
    lsf = line_spectrum.from_reflection(model.reflection)
    variance = (model.gain * factor) ** 2
    return HattTexture.from_models(speed, force, line_spectrum.spread(lsf), variance, fs, name=texture.name)
