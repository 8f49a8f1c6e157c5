"""A planned scene: which model each surface got, in one file that the renderer loads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.scene.models import GridModel, total_bytes

MOST_MODELS = 10_000
MOST_CONTACTS = 1000
_NAMES = {"name", "fs", "unit", "band_hz", "largest_output", "contacts", "surfaces", "models"}
_PARTS = ("speeds", "forces", "rows", "power", "frequency_hz", "per_mm")


@dataclass(frozen=True, eq=False)
class PlannedScene:
    """What `plan_scene` chose, ready to be rendered.

    Parameters
    ----------
    name : str
        Of the scene.
    fs : float
        Rate of the device, Hz.
    unit : str
        Of the vibration.
    band_hz : (float, float)
        Of the device.
    largest_output : float
        Of the device, in `unit`: no rendered sample exceeds it.
    contacts : int
        Simultaneous ones.
    assigned : mapping of str to int
        Surface -> index of its model; surfaces that do not differ share one.
    models : sequence of GridModel

    Raises
    ------
    ValueError
        If something breaks a rule.
    """

    family: ClassVar[str] = "scene"
    name: str
    fs: float
    unit: str
    band_hz: tuple[float, float]
    largest_output: float
    contacts: int
    assigned: Mapping[str, int]
    models: tuple[GridModel, ...]

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not (0 <= low < high <= self.fs / 2 and np.isfinite(self.fs)):
            raise ValueError(
                f"band is {self.band_hz} Hz, fs {self.fs} Hz; the rule is 0 <= low < high <= fs/2"
            )
        if not (np.isfinite(self.largest_output) and self.largest_output > 0):
            raise ValueError(f"largest output is {self.largest_output}; the rule is above 0")
        if not 1 <= self.contacts <= MOST_CONTACTS:
            raise ValueError(f"contacts are {self.contacts!r:.40}; the rule is 1 to {MOST_CONTACTS}")
        if not self.assigned or any(not 0 <= i < len(self.models) for i in self.assigned.values()):
            raise ValueError(
                f"surfaces have models {list(self.assigned.values())} of {len(self.models)}; "
                "the rule is a surface at least, each with one of the models"
            )

    def model_of(self, surface: str) -> GridModel:
        """Return the model of a surface."""
        if surface not in self.assigned:
            raise ValueError(f"surface is {surface!r}; the rule is one of {', '.join(self.assigned)}")
        return self.models[self.assigned[surface]]

    @property
    def n_bytes(self) -> int:
        """Of the models."""
        return total_bytes(self.models)

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample of one contact: mean over the surfaces."""
        return float(np.mean([self.model_of(name).operations(self.fs) for name in self.assigned]))

    def save(self, path: str | Path) -> Path:
        """Write the scene as one `.texture` file."""
        from texclass.exchange import save_texture

        return save_texture(self, path, unit=self.unit)

    def parameters(self) -> Mapping[str, Any]:
        """Return what is not an array, as JSON knows it."""
        return {
            "name": self.name,
            "fs": self.fs,
            "unit": self.unit,
            "band_hz": list(self.band_hz),
            "largest_output": self.largest_output,
            "contacts": self.contacts,
            "surfaces": dict(self.assigned),
            "models": [
                {"order": m.order, "lines": m.n_lines, "nodes": list(m.n_nodes), "peak": m.peak}
                for m in self.models
            ],
        }

    def arrays(self) -> Mapping[str, NDArray[np.float64]]:
        """Return the parts of all models, one behind the other."""
        return {part: np.concatenate([getattr(m, part).ravel() for m in self.models]) for part in _PARTS}

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the scene that was written down; a ValueError says what is wrong with it."""
        if set(parameters) != _NAMES or set(arrays) != set(_PARTS):
            found = sorted(map(str, [*parameters, *arrays]))
            raise ValueError(f"scene: holds {found}; the rule is {sorted([*_NAMES, *_PARTS])}")
        p = parameters
        models = _models(p["models"], {name: np.ravel(arrays[name]) for name in _PARTS})
        assigned = {str(name): _count(i, "model of a surface") for name, i in dict(p["surfaces"]).items()}
        low, high = map(float, p["band_hz"])
        return cls(
            str(p["name"]),
            float(p["fs"]),
            str(p["unit"]),
            (low, high),
            float(p["largest_output"]),
            _count(p["contacts"], "contacts"),
            assigned,
            models,
        )


def load_scene(path: str | Path) -> PlannedScene:
    """Return the planned scene of a file.

    Raises
    ------
    ValueError
        As `texclass.exchange.read_texture_file`, or if the file holds no scene.
    OSError
        If it cannot be read.
    """
    from texclass.exchange import read_texture_file, restore

    found = restore(read_texture_file(path), path)
    if not isinstance(found, PlannedScene):
        raise ValueError(f"{path}: holds {found.family!r}; the rule is a planned scene (texclass scene plan)")
    return found


def _models(described: Sequence[Mapping[str, Any]], parts: Mapping[str, Samples]) -> tuple[GridModel, ...]:
    """Cut the joined parts at what the models say of their sizes."""
    if not isinstance(described, list) or len(described) > MOST_MODELS:
        raise ValueError(f"models are {described!s:.80}; the rule is a list of at most {MOST_MODELS}")
    at, models = dict.fromkeys(parts, 0), []
    for one in described:
        if not isinstance(one, Mapping) or set(one) != {"order", "lines", "nodes", "peak"}:
            raise ValueError(f"a model is {one!s:.80}; the rule is order, lines, nodes, peak")
        n_v, n_f = (_count(n, "nodes") for n in one["nodes"])
        p, n = _count(one["order"], "order"), _count(one["lines"], "lines")
        shapes = (n_v,), (n_f,), (n_v, n_f, p + n), (n_v, n_f), (n,), (n,)
        cut = {}
        for name, shape in zip(_PARTS, shapes, strict=True):
            stop = at[name] + int(np.prod(shape, dtype=object))
            if stop > parts[name].size:
                raise ValueError(f"{name} holds {parts[name].size} numbers; the rule is {stop} at least")
            cut[name] = parts[name][at[name] : stop].reshape(shape)
            at[name] = stop
        models.append(GridModel(peak=float(one["peak"]), **cut))
    if any(at[name] != parts[name].size for name in parts):
        raise ValueError("the arrays hold more than the models say; the rule is no more")
    return tuple(models)


def _count(value: Any, what: str) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"{what} is {value!r:.40}; the rule is a whole number, at least 0")
    return value
