"""A texture small enough for tests, and archives as hostile as they can be made."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest

from texclass.exchange import archive, npy
from texclass.exchange.description import encode, parse_json
from texclass.exchange.families import FAMILIES
from texclass.textures.hatt import HattTexture


@dataclass
class Hum:
    """Plays a tone, as loud as the stroke is fast."""

    family: ClassVar[str] = "hum"
    name: str = "hum"
    fs: float = 1000.0
    tones: np.ndarray = field(default_factory=lambda: np.array([[50.0, 1.0], [120.5, 0.25]]))
    operations: ClassVar[float] = 4.0

    def renderer(self, *, seed=0):
        raise NotImplementedError

    def parameters(self):
        return {"name": self.name, "fs": self.fs, "note": ["low", 1, True, None, 0.1]}

    def arrays(self):
        return {"tones": self.tones}

    @classmethod
    def restore(cls, parameters, arrays):
        if arrays["tones"].ndim != 2:
            raise ValueError(f"tones have shape {arrays['tones'].shape}; the rule is (n, 2)")
        return cls(parameters["name"], parameters["fs"], arrays["tones"])


@pytest.fixture
def hum(monkeypatch):
    """A texture of a family that only tests know."""
    monkeypatch.setitem(FAMILIES, "hum", lambda: Hum)
    return Hum()


@pytest.fixture
def forge():
    """Return a function that changes a file's members and description, checksum included."""

    def change(path, description=None, **members):
        found = archive.unpack(path)
        parsed = parse_json(found["texture.json"], "test")
        del parsed["sha256"]
        for key, value in (description or {}).items():
            inner = parsed
            *way, last = key.split("/")
            for step in way:
                inner = inner[step]
            if value is None:
                del inner[last]
            else:
                inner[last] = value
        found["texture.json"] = encode(parsed)
        path.write_bytes(archive.pack(found | {f"arrays/{name}.npy": data for name, data in members.items()}))
        return path

    return change


@pytest.fixture(scope="session")
def slate():
    """A HaTT texture, AR order 4 and MA order 2."""
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


@pytest.fixture
def dumped():
    """Return the bytes of an array as a member."""
    return npy.dump
