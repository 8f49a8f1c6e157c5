"""Read and write textures of the Penn Haptic Texture Toolkit (HaTT), and convert other families to HaTT.

The file layout was verified with the one hundred published textures at 1000 Hz, and with source files in
public copies of the toolkit: the MATLAB writer, the stylesheet and the C++ renderer (files:
github.com/Student-in-job/Penn_Toolkit; original: repository.upenn.edu/meam_papers/299). The licence of the
toolkit permits non-profit research and forbids redistribution. This package contains no part of the toolkit;
the tests write their own files.

    modelSet (texture="0")
      material, AccelUnits (m/s^2), SpeedUnits (mm/s), ForceUnits (N), SampleRate (Hz), mu,
      htmlPicture, htmlLinuxPicture, renderPicture,
      numMod, numTri, maxSpeed, maxForce,
      speedList, forceList (type="array"): value, one per model
      tri (type="array"), one per triangle: three values, the numbers of models (from 1)
      DTpicture, LinuxDTpicture, numARCoeff, numMACoeff
      model: modNum, ARcoeff and MAcoeff: value (lag 0 first: 1), ARlsf and MAlsf: value (rad per sample),
             var, gain, speedMod, forceMod

The rendered signal is y = -sum_i a_i y[t-i] + gain (e + sum_i c_i e[t-i]) with noise e of variance `var`.
Line spectra, `var` and `gain` are interpolated with barycentric coordinates. If numMACoeff is 0 or missing,
the toolkit ignores the gain. The published models have 14 to 20 AR coefficients and two fewer MA
coefficients. Nodes at zero speed or force have `var` 0. The triangles fill the rectangle from zero to
maxSpeed and maxForce. The toolkit begins its search for the triangle that contains a point at the sixteenth
triangle.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.exchange.external_files import check_printable, read_limited
from texclass.haptics.textures import Texture
from texclass.haptics.textures.hatt import HattTexture, Mesh
from texclass.haptics.textures.oeztuerk2018 import LpcTexture
from texclass.haptics.textures.packed import PackedTexture
from texclass.recording import ACCELERATION_UNITS, Samples
from texclass.vibration import Autoregression, line_spectrum
from texclass.vibration.autoregressive import from_autocorrelation, from_direct_form

MAX_FILE_BYTES = 8 << 20
"""Largest size of a file in bytes; the published textures have about 120,000 bytes."""
MAX_ELEMENTS, MAX_DEPTH = 300_000, 16
MAX_MODELS = 10_000
_UNITS = {"AccelUnits": "m/s^2", "SpeedUnits": "mm/s", "ForceUnits": "N"}
_TOLERANCE = 2e-6
"""Largest accepted difference between coefficients and line spectra in rad; the published line spectra have
six decimals."""
FS = 1000.0
"""Sampling rate of the toolkit in Hz."""
ORDER = 20
"""Largest order of the AR models in the published textures."""


def read_hatt(path: str | Path) -> HattTexture:
    """Read a texture from a HaTT XML file.

    The line spectra are read from ARlsf and MAlsf, as in the toolkit's renderer, and must agree with ARcoeff
    and MAcoeff. If they are rounded to six decimals, they are recomputed from ARcoeff and MAcoeff.

    Parameters
    ----------
    path : str or Path
        File to read.

    Raises
    ------
    ValueError
        If the XML is not well formed or declares a document type (entities are never expanded); if counts,
        units or triangles are wrong or a number is NaN; or if an AR part is unstable or an MA part is not
        minimum-phase.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> texture = HattTexture.from_models([100.0], [1.0], [[1.0, 2.0]], [0.25], fs=1000.0, name="cork")
    >>> path = write_hatt(texture, pathlib.Path(tempfile.mkdtemp()) / "cork.xml")
    >>> read_hatt(path).name
    'cork'
    """
    path = Path(path)
    data = read_limited(path, MAX_FILE_BYTES)
    parser = ElementTree.XMLParser(target=_BoundedTree(), encoding="utf-8")
    try:
        parser.feed(data)
        return _texture(parser.close())
    except ElementTree.ParseError as error:
        raise ValueError(f"{path} is not well formed ({error}). Expected XML in UTF-8") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


class _BoundedTree(ElementTree.TreeBuilder):
    """Tree builder that rejects document types, and elements or levels that could exhaust the memory."""

    def __init__(self) -> None:
        super().__init__()
        self._count = self._depth = 0

    def start(self, tag: str, attributes: dict[str, str]) -> Element:
        self._count, self._depth = self._count + 1, self._depth + 1
        if self._count > MAX_ELEMENTS or self._depth > MAX_DEPTH:
            raise ValueError(f"the file must have at most {MAX_ELEMENTS} elements and {MAX_DEPTH} levels")
        return super().start(tag, {})

    def end(self, tag: str) -> Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, *_: str | None) -> None:
        raise ValueError(
            f"the file declares the document type {name!r:.40}. Remove the declaration and all entities"
        )


def _texture(root: Element) -> HattTexture:
    if root.tag != "modelSet":
        raise ValueError(f"the root element must be <modelSet>, got <{root.tag:.40}>")
    optional = _UNITS | {"material": "", "mu": "0", "numMACoeff": "0"}
    for tag, default in optional.items():
        if root.find(tag) is None:
            ElementTree.SubElement(root, tag).text = default
    for tag, unit in _UNITS.items():
        if (text := _text(root, tag)) != unit:
            raise ValueError(f"<{tag}> must be {unit!r}, got {text!r:.40}")
    models, triangles = root.findall("model"), root.findall("tri")
    n, n_triangles = _count(root, "numMod"), _count(root, "numTri")
    speed, force = (_numbers(_child(root, tag), n) for tag in ("speedList", "forceList"))
    if not 0 < n <= MAX_MODELS or len(models) != n or len(triangles) != n_triangles:
        raise ValueError(
            f"numMod is {n} and numTri is {n_triangles}, but the file contains {len(models)} models "
            f"and {len(triangles)} triangles. Expected equal numbers, and 1 to {MAX_MODELS} models"
        )
    corners = np.array([_numbers(triangle, 3) for triangle in triangles]).reshape(-1, 3)
    # the models may be in a different order than speedList and forceList
    models_by_point = {(_number(m, "speedMod"), _number(m, "forceMod")): m for m in models}
    points = list(zip(speed.tolist(), force.tolist(), strict=True))
    if len(models_by_point) != n or set(points) != set(models_by_point):
        raise ValueError(
            "speedMod and forceMod of the models differ from speedList and forceList, or contain duplicates. "
            "Expected equal values, without duplicates"
        )
    p, q = _count(root, "numARCoeff"), _count(root, "numMACoeff")
    models = [models_by_point[point] for point in points]
    return HattTexture(
        Mesh(speed, force, corners - 1),
        ar_lsf=np.array([_frequencies(model, "AR", p) for model in models]),
        ma_lsf=np.array([_frequencies(model, "MA", q) for model in models]),
        variance=np.array([_number(model, "var") for model in models]),
        gain=np.array([_number(model, "gain") if q else 1.0 for model in models]),
        fs=_number(root, "SampleRate"),
        name=check_printable(_text(root, "material")),
        mu=_number(root, "mu"),
    )


def _frequencies(model: Element, part: str, order: int) -> Samples:
    """Return the line spectral frequencies (order,) of the AR or MA part of a model."""
    if not order:
        return np.zeros(0)
    elements = {tag: _optional_child(model, tag) for tag in (f"{part}lsf", f"{part}coeff")}
    try:
        lsf, coefficients = (
            None if element is None else _numbers(element, n)
            for element, n in zip(elements.values(), (order, order + 1), strict=True)
        )
        if lsf is None and coefficients is None:
            raise ValueError(f"{part}coeff and {part}lsf are missing. Expected at least one of them")
        if coefficients is not None:
            exact = line_spectrum.from_reflection(from_direct_form(coefficients, 1.0).reflection)
            error_rad = 0.0 if lsf is None else float(np.abs(lsf - exact).max())
            if not error_rad <= _TOLERANCE:
                raise ValueError(
                    f"{part}coeff and {part}lsf differ by {error_rad:.3g} rad. Expected at most {_TOLERANCE}"
                )
            if lsf is None or np.array_equal(np.round(lsf, 6), lsf):
                return line_spectrum.spread(exact)
        if lsf is None or np.any(np.diff(lsf) < 0) or lsf[0] < 0 or lsf[-1] > math.pi:
            raise ValueError(f"{part}lsf must increase from 0 to pi; otherwise the model is unstable")
        return line_spectrum.spread(lsf)
    except ValueError as error:
        raise ValueError(f"model {model.findtext('modNum', '?')!r:.20}: {part}: {error}") from error


def _optional_child(element: Element, tag: str) -> Element | None:
    children = element.findall(tag)
    if len(children) > 1:
        raise ValueError(f"<{element.tag}> must contain one <{tag}>, got {len(children)} <{tag}>")
    return children[0] if children else None


def _child(element: Element, tag: str) -> Element:
    if (child := _optional_child(element, tag)) is None:
        raise ValueError(f"<{element.tag}> must contain one <{tag}>, got no <{tag}>")
    return child


def _numbers(element: Element, n: int) -> Samples:
    values = [_parse(value) for value in element.findall("value")]
    if len(values) != n or len(element) != n:
        raise ValueError(f"<{element.tag}> must contain {n} values, got {len(element)}")
    return np.array(values)


def _number(element: Element, tag: str) -> float:
    return _parse(_child(element, tag))


def _count(element: Element, tag: str) -> int:
    value = _number(element, tag)
    if not (value == int(value) and 0 <= value <= 1e6):
        raise ValueError(f"<{tag}> must be a count, got {value:g}")
    return int(value)


def _text(element: Element, tag: str) -> str:
    return (_child(element, tag).text or "").strip()


def _parse(element: Element) -> float:
    text = element.text or ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"<{element.tag}> must be a finite number, got {text!r:.40}")
    return value


def write_hatt(texture: HattTexture, path: str | Path) -> Path:
    """Write a texture as HaTT XML with full precision, atomically.

    The toolkit ignores SampleRate and always renders at 1000 Hz. Fit models for the toolkit at this rate.

    Parameters
    ----------
    texture : HattTexture
        Texture, for example the result of `to_hatt`.
    path : str or Path
        File to write; must end in `.xml`.

    Raises
    ------
    ValueError
        If the path does not end in `.xml`, the name is not printable, or the order is so high that the direct
        form (ARcoeff) is numerically inaccurate.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> texture = HattTexture.from_models([100.0], [1.0], [[1.0, 2.0]], [0.25], fs=1000.0, name="cork")
    >>> write_hatt(texture, pathlib.Path(tempfile.mkdtemp()) / "cork.xml").name
    'cork.xml'
    """
    path = check_suffix(path, ".xml")
    root, mesh = Element("modelSet", texture="0"), texture.mesh
    image = f"{check_printable(texture.name)}_square.bmp"
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
        # the toolkit ignores the gain if there is no MA part
        gain, has_ma = float(texture.gain[i]), bool(texture.ma_order)
        _add(model, "var", float(texture.variance[i]) * (1.0 if has_ma else gain**2))
        _add(model, "gain", gain if has_ma else 1.0)
        _add(model, "speedMod", float(mesh.speed[i]))
        _add(model, "forceMod", float(mesh.force[i]))
    ElementTree.indent(root, "")
    text = ElementTree.tostring(root, encoding="unicode", short_empty_elements=False)
    write_atomic(path, f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'.encode())
    return path


def _add(
    parent: Element, tag: str, value: str | float | Samples, array: dict[str, str] | None = None
) -> None:
    """Append an element that contains text, a number, or one <value> for each number of an array."""
    if isinstance(value, np.ndarray):
        child = ElementTree.SubElement(parent, tag, array or {})
        for number in value.tolist():
            _add(child, "value", number)
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
    """Convert a texture with AR models to a HaTT texture.

    If the order or the sampling rate of the texture is higher, each model is refitted to its spectrum below
    fs / 2. For anisotropic textures, strokes along +x are used. If a texture does not depend on the force,
    its models are placed at 1 N. Below this force, the converted vibration is weaker; above it, the vibration
    is constant.

    Parameters
    ----------
    texture : Texture
        Texture with AR models, of the family hatt, abdulali2016, oeztuerk2018-lpc or packed. For a HaTT
        texture, only the unit is converted.
    unit : str
        Unit of the vibration: m/s^2 (default), g or mg.
    speeds, forces : sequence of float, optional
        Positive speeds (mm/s) and forces (N) of the models (default: six uniform steps up to the largest
        values of the texture; for LPC textures, the speeds of the texture).
    fs : float
        Sampling rate in Hz (default 1000), at most the sampling rate of the texture.
    order : int
        Largest order of the models (default 20).

    Raises
    ------
    ValueError
        If the texture has no AR models, its sampling rate is below `fs`, its unit cannot be converted to
        m/s^2, or a speed or a force is not positive.

    Examples
    --------
    >>> from texclass.haptics.textures import pack
    >>> noise = pack(np.random.default_rng(0).standard_normal(2000), n_bytes=32, fs=1000)
    >>> texture = to_hatt(noise, speeds=[50.0, 150.0], forces=[1.0], order=4)
    >>> texture.order, texture.mesh.largest
    (4, (150.0, 1.0))
    """
    if unit not in ACCELERATION_UNITS:
        raise ValueError(f"unit must be one of {', '.join(ACCELERATION_UNITS)} for HaTT, got {unit!r}")
    factor = ACCELERATION_UNITS[unit]
    if isinstance(texture, HattTexture):
        return replace(texture, variance=texture.variance * factor**2)
    steps = np.arange(1, 7) / 6
    own: Sequence[Sequence[float] | Samples] = texture.speeds[-1] * steps, texture.forces[-1] * steps
    if isinstance(texture, LpcTexture):
        own = texture.speeds, texture.forces
    elif isinstance(texture, PackedTexture) and texture.speeds.size == 1:
        own = texture.model.axes  # the vibration fades out below these values and is constant above them
    grid = [np.array(axis, dtype=np.float64) for axis in (speeds or own[0], forces or own[1])]
    if not all(np.all(np.isfinite(axis) & (axis > 0)) for axis in grid):
        raise ValueError(f"speeds and forces must be positive, got {grid[0].tolist()} and {grid[1].tolist()}")
    if not 0 < fs <= texture.fs:
        raise ValueError(
            f"fs must be positive and at most {texture.fs:g} Hz (as in the texture), got {fs:g} Hz"
        )
    speed, force = (axis.ravel() for axis in np.meshgrid(*grid, indexing="ij"))
    model = texture.autoregressions(speed, force)
    if fs != texture.fs or model.order > order:
        # autocorrelation of the spectrum below fs / 2: r_i = (1 / N) sum_n S(w_n) (fs / fs_0) e^{j i w_n}
        ratio = fs / texture.fs
        with np.errstate(under="ignore"):
            spectrum_db = model.log_spectrum_db(np.linspace(0, np.pi, (1 << 14) + 1) * ratio)
            power = 10 ** (spectrum_db / 10) * ratio
        model = from_autocorrelation(np.fft.irfft(power, axis=-1)[..., : order + 1])
    lsf = line_spectrum.from_reflection(model.reflection)
    variance = (model.gain * factor) ** 2
    return HattTexture.from_models(speed, force, line_spectrum.spread(lsf), variance, fs, name=texture.name)
