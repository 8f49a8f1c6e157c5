"""Textures of the Penn Haptic Texture Toolkit (HaTT), read and written.

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
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from texclass.exchange.limited import checked_name
from texclass.exchange.xml_tree import Element, parse_xml
from texclass.recording import Samples
from texclass.textures.hatt import HattTexture, Mesh
from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import from_direct_form

MOST_MODELS = 10_000
_UNITS = {"AccelUnits": "m/s^2", "SpeedUnits": "mm/s", "ForceUnits": "N"}
_DECIMALS = 6
"""Of the line spectra in the published files: those of the coefficients, rounded."""
_TOLERANCE = 2e-6


def read_hatt(path: str | Path) -> HattTexture:
    """Return the texture of a HaTT file.

    The line spectra are those of ARlsf and MAlsf, which the toolkit renders; where they are rounded to six
    decimals, those of ARcoeff and MAcoeff, which they must agree with.

    Raises
    ------
    ValueError
        If it is not well formed, declares entities, has wrong counts, units or triangles, NaN, or a model
        that is not stable (or an MA part not of minimum phase); the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    root = parse_xml(path)
    try:
        return _texture(root)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _texture(root: Element) -> HattTexture:
    if root.tag != "modelSet":
        raise ValueError(f"is a <{root.tag:.40}>; the rule is <modelSet>")
    for tag, unit in _UNITS.items():
        if _text(root, tag, unit) != unit:
            raise ValueError(f"<{tag}> is {_text(root, tag, unit)!r:.40}; the rule is {unit!r}")
    models, mesh = list(root.all("model")), _mesh(root)
    p, q = _count(root, "numARCoeff"), _count(root, "numMACoeff", 0)
    order = _places(models, mesh.speed, mesh.force)
    return HattTexture(
        mesh,
        ar_lsf=np.array([_frequencies(model, "AR", p) for model in models])[order],
        ma_lsf=np.array([_frequencies(model, "MA", q) for model in models])[order],
        variance=np.array([_number(model, "var") for model in models])[order],
        gain=np.array([_number(model, "gain") if q else 1.0 for model in models])[order],
        fs=_number(root, "SampleRate"),
        name=checked_name(_text(root, "material", ""), "material"),
        mu=_number(root, "mu", 0.0),
    )


def _mesh(root: Element) -> Mesh:
    n, n_triangles = _count(root, "numMod"), _count(root, "numTri")
    speed, force = _values(root, "speedList", n), _values(root, "forceList", n)
    n_models, triangles = sum(1 for _ in root.all("model")), list(root.all("tri"))
    if not 0 < n <= MOST_MODELS or n_models != n or len(triangles) != n_triangles:
        raise ValueError(
            f"holds {n_models} models, {len(triangles)} triangles, numMod is {n}, numTri {n_triangles}; "
            f"the rule is the same, 1 to {MOST_MODELS} models"
        )
    corners = np.array([_numbers(triangle, 3) for triangle in triangles]).reshape(-1, 3)
    return Mesh(speed, force, corners - 1)


def _places(models: list[Element], speed: Samples, force: Samples) -> NDArray[np.int64]:
    """Return which model stands at each point of the lists; in the published files that of the same place."""
    of_models = [(_number(model, "speedMod"), _number(model, "forceMod")) for model in models]
    points = list(zip(speed.tolist(), force.tolist(), strict=True))
    places = {point: i for i, point in enumerate(of_models)}
    if len(places) != len(points) or set(points) != set(of_models):
        raise ValueError(
            "the speeds and forces of the models are not those of speedList and forceList; "
            "the rule is the same, none twice"
        )
    return np.array([places[point] for point in points])


def _frequencies(model: Element, part: str, order: int) -> Samples:
    """Return the line spectral frequencies (order,) of the AR or MA part of a model."""
    if not order:
        return np.zeros(0)
    where = f"model {_text(model, 'modNum', '?')!r:.20}: "
    lsf, coefficients = _optional(model, f"{part}lsf", order), _optional(model, f"{part}coeff", order + 1)
    try:
        if coefficients is None:
            if lsf is None:
                raise ValueError(f"holds neither {part}coeff nor {part}lsf; the rule is one of them")
            return line_spectrum.spread(_rising(lsf, f"{part}lsf"))
        exact = line_spectrum.from_reflection(from_direct_form(coefficients, 1.0).reflection)
        if lsf is None:
            return line_spectrum.spread(exact)
        worst = float(np.abs(lsf - exact).max())
        if not worst <= _TOLERANCE:
            raise ValueError(f"{part}coeff and {part}lsf are {worst:.3g} rad apart; the rule is {_TOLERANCE}")
        rounded = np.array_equal(np.round(lsf, _DECIMALS), lsf)
        return line_spectrum.spread(exact if rounded else _rising(lsf, f"{part}lsf"))
    except ValueError as error:
        raise ValueError(f"{where}{part}: {error}") from error


def _rising(lsf: Samples, name: str) -> Samples:
    if not (np.all(np.diff(lsf) >= 0) and lsf[0] >= 0 and lsf[-1] <= math.pi):
        raise ValueError(f"{name} is not rising in 0 ... pi; the rule is rising line spectra: a stable model")
    return lsf


def _optional(model: Element, tag: str, n: int) -> Samples | None:
    found = model.one(tag)
    return None if found is None else _numbers(found, n)


def _values(root: Element, tag: str, n: int) -> Samples:
    found = root.one(tag)
    if found is None:
        raise ValueError(f"<{root.tag}> holds no <{tag}>; the rule is one")
    return _numbers(found, n)


def _numbers(element: Element, n: int) -> Samples:
    values = [_parsed(value.text, element.tag) for value in element.all("value")]
    if len(values) != n or len(element.children) != n:
        raise ValueError(f"<{element.tag}> holds {len(element.children)} values; the rule is {n}")
    return np.array(values)


def _number(element: Element, tag: str, default: float | None = None) -> float:
    found = element.one(tag)
    if found is None and default is not None:
        return default
    if found is None:
        raise ValueError(f"<{element.tag}> holds no <{tag}>; the rule is one")
    return _parsed(found.text, tag)


def _count(element: Element, tag: str, default: float | None = None) -> int:
    value = _number(element, tag, default)
    if not (value == int(value) and 0 <= value <= 1e6):
        raise ValueError(f"<{tag}> is {value:g}; the rule is a count")
    return int(value)


def _text(element: Element, tag: str, default: str) -> str:
    found = element.one(tag)
    return default if found is None else found.text.strip()


def _parsed(text: str, tag: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"<{tag}> holds {text!r:.40}; the rule is a finite number")
    return value
