"""Recipes of simulated datasets. Their recordings can be simulated in any order and in any process."""

import hashlib
from typing import Self

from pydantic import Field, model_validator

from texclass.provenance import code_hash
from texclass.recording import Recording
from texclass.simulate.hand import Operator, operator_catalogue
from texclass.simulate.surfaces import Surface, surface_catalogue
from texclass.validation import StrictModel


class Recipe(StrictModel):
    """Recipe of a simulated dataset with a fixed number of recordings of each surface.

    Parameters
    ----------
    n_surfaces, n_recordings, n_operators : int
        Numbers of surfaces, of recordings of each surface, and of operators; 1 to 1000 each. Operator
        (r - 1) mod n_operators makes recording r of a surface.
    duration_s : float
        Duration of each recording in s.
    fs : float
        Sampling rate in Hz.
    seed : int
        Seed of the catalogues and the recordings.

    Raises
    ------
    ValueError
        If a number is out of range, or a recording would have more than 1e9 samples.

    Examples
    --------
    >>> recipe = Recipe(n_surfaces=2, n_recordings=2, n_operators=2, duration_s=3.0, fs=1_000.0, seed=0)
    >>> recipe.entries()[:2]
    (('stone-01-01', 'stone-01', 'operator-1', 1), ('stone-01-02', 'stone-01', 'operator-2', 2))
    >>> recipe.record(surface_index=0, repetition=1).acceleration.shape
    (3000, 3)
    """

    n_surfaces: int = Field(ge=1, le=1000)
    n_recordings: int = Field(ge=1, le=1000)
    n_operators: int = Field(ge=1, le=1000)
    duration_s: float = Field(gt=0)
    fs: float = Field(gt=0)
    seed: int = Field(ge=0)

    @model_validator(mode="after")
    def _fits_a_machine(self) -> Self:
        if self.duration_s * self.fs > 1e9:
            raise ValueError(
                f"a recording must have at most 1e+09 samples, got {self.duration_s:g} s at {self.fs:g} Hz"
            )
        return self

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """Surfaces of the dataset."""
        return surface_catalogue(self.n_surfaces, self.seed)

    @property
    def operators(self) -> tuple[Operator, ...]:
        """Operators of the dataset."""
        return operator_catalogue(self.n_operators, self.seed)

    def entries(self) -> tuple[tuple[str, str, str, int], ...]:
        """Return name, surface, operator and repetition (from 1) of each recording, ordered by surface."""
        operators = self.operators
        return tuple(
            (f"{surface.name}-{k:02d}", surface.name, operators[(k - 1) % self.n_operators].name, k)
            for surface in self.surfaces
            for k in range(1, self.n_recordings + 1)
        )

    def record(self, surface_index: int, repetition: int) -> Recording:
        """Return one recording of the dataset, with its true phases.

        Parameters
        ----------
        surface_index : int
            Index of the surface, from 0.
        repetition : int
            Repetition, from 1.

        Returns
        -------
        Recording
            Simulated recording.

        Raises
        ------
        IndexError
            If the recipe has no such recording.
        """
        if not (0 <= surface_index < self.n_surfaces and 1 <= repetition <= self.n_recordings):
            raise IndexError(
                f"surface_index must lie between 0 and {self.n_surfaces - 1} and repetition between 1 and "
                f"{self.n_recordings}, got {surface_index} and {repetition}"
            )
        from texclass.simulate.freehand import record_freehand  # loads numba, which `entries` does not need

        operator_index = (repetition - 1) % self.n_operators
        return record_freehand(
            self.surfaces[surface_index],
            self.operators[operator_index],
            duration_s=self.duration_s,
            fs=self.fs,
            seed=(self.seed, surface_index, operator_index, repetition),
            recording_id=f"{self.surfaces[surface_index].name}-{repetition:02d}",
            repetition=repetition,
        )

    def fingerprint(self) -> str:
        """Return a hex digest of the recipe and the code of the simulation."""
        return hashlib.sha256(f"{self!r} {code_hash('simulate', words=False)}".encode()).hexdigest()
