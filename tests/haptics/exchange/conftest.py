"""A small texture for tests, and files with any header and arrays."""

import json
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest
from pydantic import ValidationError
from safetensors.numpy import save
from spoiling import REMOVED, replace_value

from texclass.haptics.exchange.texture_file import TEXTURES, Header, read_container, to_bytes
from texclass.haptics.textures.contract import Serializable
from texclass.haptics.textures.hatt import HattTexture


@dataclass
class Hum(Serializable):
    """A texture whose level is proportional to the speed of the stroke."""

    family: ClassVar[str] = "hum"
    operations: ClassVar[float] = 4.0
    speeds: ClassVar[np.ndarray] = np.array([20.0, 60.0])
    forces: ClassVar[np.ndarray] = np.array([1.0])
    name: str = "hum"
    fs: float = 1000.0
    note: tuple[str | float | bool | None, ...] = ("low", 1, True, None, 0.1)
    tones: np.ndarray = field(default_factory=lambda: np.array([[50.0, 1.0], [120.5, 0.25]]))

    def __post_init__(self):
        if self.tones.ndim != 2:
            raise ValueError(f"tones must have shape (n, 2), got {self.tones.shape}")

    def renderer(self, *, seed=0):
        raise NotImplementedError


@pytest.fixture
def hum(monkeypatch):
    """Return a texture of a family that is registered for one test."""
    monkeypatch.setitem(TEXTURES, "hum", Hum)
    return Hum()


def make_file(content, arrays):
    """Return the bytes of a file with any header and arrays, with a correct checksum if possible."""
    try:
        return to_bytes(Header.model_validate({**content, "sha256": ""}), arrays)
    except (ValidationError, OverflowError):
        return save(arrays, {"texclass": json.dumps(content)})


@pytest.fixture
def forge():
    """Return a function that changes the header and arrays of a file, and its checksum."""

    def change(path, changes=None, **arrays):
        header, original_arrays = read_container(path)
        content = header.model_dump()
        for key, value in (changes or {}).items():
            replace_value(content, tuple(key.split("/")), REMOVED if value is None else value)
        path.write_bytes(make_file(content, original_arrays | arrays))
        return path

    return change


@pytest.fixture(scope="session")
def slate():
    """Return a HaTT texture of AR order 4 and MA order 2."""
    rng = np.random.default_rng(7)
    gaps = rng.uniform(0.5, 1.5, (5, 5))
    lsf = np.cumsum(gaps, axis=1)[:, :-1] / gaps.sum(axis=1, keepdims=True) * np.pi
    return HattTexture.from_models(
        [40.0, 80.0, 120.0, 160.0, 90.0],
        [0.5, 2.0, 1.0, 3.0, 1.2],
        lsf,
        np.linspace(0.01, 0.05, 5),
        1000.0,
        ma_lsf=lsf[:, 1:3],
        gain=np.linspace(1, 2, 5),
        name="slate & chalk",
        mu=0.25,
    )
