"""A planned scene: which model each surface got, in one file that the renderer loads."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from texclass.exchange.container import read_stored, write_stored
from texclass.textures.contract import StoredFields
from texclass.textures.grid import GridModel

MOST_CONTACTS = 1000


@dataclass(frozen=True, eq=False)
class PlannedScene(StoredFields):
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
        Over logarithms of speed and force.

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
        odd = [model for model in self.models if (len(model.axes), model.scale) != (2, "log")]
        if odd:
            found = f"{len(odd[0].axes)} axes, scale {odd[0].scale!r}"
            raise ValueError(f"a model has {found}; the rule is speed and force, 'log'")

    def model_of(self, surface: str) -> GridModel:
        """Return the model of a surface."""
        if surface not in self.assigned:
            raise ValueError(f"surface is {surface!r}; the rule is one of {', '.join(self.assigned)}")
        return self.models[self.assigned[surface]]

    @property
    def n_bytes(self) -> int:
        """Of the models."""
        return sum(model.n_bytes for model in self.models)

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample of one contact: mean over the surfaces."""
        return float(np.mean([self.model_of(name).operations(self.fs) for name in self.assigned]))

    def save(self, path: str | Path) -> Path:
        """Write the scene as one `.texture` file."""
        return write_stored(self, path, unit=self.unit)


def load_scene(path: str | Path) -> PlannedScene:
    """Return the planned scene of a file, as `texclass scene plan` or `PlannedScene.save` wrote it.

    Raises
    ------
    ValueError
        If the file is damaged, breaks a rule, or holds no scene; the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    scene: PlannedScene = read_stored(path, {PlannedScene.family: PlannedScene})
    return scene
