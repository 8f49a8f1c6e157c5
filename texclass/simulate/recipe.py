"""Recipes of whole simulated datasets: every recording can be made alone, in any order, by any process."""

import functools
import hashlib
from dataclasses import dataclass
from pathlib import Path

from texclass.recording import Recording
from texclass.simulate.catalogue import surface_catalogue
from texclass.simulate.freehand import record_freehand
from texclass.simulate.operators import Operator, operator_catalogue
from texclass.simulate.surfaces import Surface

SimulatedEntry = tuple[str, str, str, int]
"""Recording id, name of the surface, name of the operator, repetition (from 1)."""


@dataclass(frozen=True)
class Recipe:
    """A simulated dataset: surfaces x recordings, the operators taking turns.

    Parameters
    ----------
    n_surfaces, n_recordings, n_operators : int
        Surfaces, recordings of each surface, operators. Recording r of a surface is made by operator
        (r - 1) mod n_operators.
    duration_s : float
        Duration of each recording.
    fs : float
        Sampling rate in Hz.
    seed : int
        Seed of catalogues and recordings.

    Raises
    ------
    ValueError
        If a count is not positive.
    """

    n_surfaces: int
    n_recordings: int
    n_operators: int
    duration_s: float
    fs: float = 10_000.0
    seed: int = 2015

    def __post_init__(self) -> None:
        for name in ("n_surfaces", "n_recordings", "n_operators"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; the rule is at least 1")

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """The surfaces, in order."""
        return _surfaces(self.n_surfaces, self.seed)

    @property
    def operators(self) -> tuple[Operator, ...]:
        """The operators, in order."""
        return _operators(self.n_operators, self.seed)

    def entries(self) -> tuple[SimulatedEntry, ...]:
        """Return what is known of each recording before it is made: surface by surface, in order of time."""
        return tuple(
            self._entry(surface_index, repetition)
            for surface_index in range(self.n_surfaces)
            for repetition in range(1, self.n_recordings + 1)
        )

    def record(self, surface_index: int, repetition: int) -> Recording:
        """Return one recording of the dataset, the true phases included.

        Parameters
        ----------
        surface_index : int
            From 0.
        repetition : int
            From 1.

        Raises
        ------
        IndexError
            If the recipe has no such recording.
        """
        if not (0 <= surface_index < self.n_surfaces and 1 <= repetition <= self.n_recordings):
            raise IndexError(
                f"no recording (surface {surface_index}, repetition {repetition}); the rule is surface "
                f"0..{self.n_surfaces - 1}, repetition 1..{self.n_recordings}"
            )
        operator_index = self._operator_index(repetition)
        return record_freehand(
            self.surfaces[surface_index],
            self.operators[operator_index],
            duration_s=self.duration_s,
            fs=self.fs,
            seed=(self.seed, surface_index, operator_index, repetition),
            recording_id=self._entry(surface_index, repetition)[0],
            repetition=repetition,
        )

    def fingerprint(self) -> str:
        """Return a hex digest that changes with the recipe and with the code of the simulation."""
        digest = hashlib.sha256(repr(self).encode())
        for module in sorted(Path(__file__).parent.glob("*.py")):
            digest.update(module.read_bytes())
        return digest.hexdigest()

    def _entry(self, surface_index: int, repetition: int) -> SimulatedEntry:
        surface = self.surfaces[surface_index].name
        operator = self.operators[self._operator_index(repetition)].name
        return f"{surface}-{repetition:02d}", surface, operator, repetition

    def _operator_index(self, repetition: int) -> int:
        return (repetition - 1) % self.n_operators


@functools.lru_cache(maxsize=8)
def _surfaces(n: int, seed: int) -> tuple[Surface, ...]:
    return surface_catalogue(n, seed)


@functools.lru_cache(maxsize=8)
def _operators(n: int, seed: int) -> tuple[Operator, ...]:
    return operator_catalogue(n, seed)


PRESETS = {
    "simulated": Recipe(n_surfaces=24, n_recordings=10, n_operators=5, duration_s=6.0),
    "simulated69": Recipe(n_surfaces=69, n_recordings=10, n_operators=5, duration_s=25.0),
}
"""The embedded default dataset, and the size of the database of `strese2015`."""
