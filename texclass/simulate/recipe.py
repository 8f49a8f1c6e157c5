"""Recipes of whole simulated datasets: every recording can be made alone, in any order, by any process."""

import hashlib
from typing import Self

from pydantic import Field, model_validator

from texclass.provenance import code_hash
from texclass.recording import Recording
from texclass.simulate.hand import Operator, operator_catalogue
from texclass.simulate.surfaces import Surface, surface_catalogue
from texclass.validation import StrictModel


class Recipe(StrictModel):
    """A simulated dataset: surfaces x recordings, the operators taking turns.

    Parameters
    ----------
    n_surfaces, n_recordings, n_operators : int
        Surfaces, recordings of each surface, operators; 1 to 1000 each. Recording r of a surface is made by
        operator (r - 1) mod n_operators.
    duration_s : float
        Duration of each recording.
    fs : float
        Sampling rate in Hz.
    seed : int
        Seed of catalogues and recordings.

    Raises
    ------
    ValueError
        If a number breaks its rule, or a recording has more samples than a machine can hold.
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
            found = f"{self.duration_s:g} s at {self.fs:g} Hz"
            raise ValueError(f"a recording must have at most 1e+09 samples, got {found}")
        return self

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """The surfaces, in order."""
        return surface_catalogue(self.n_surfaces, self.seed)

    @property
    def operators(self) -> tuple[Operator, ...]:
        """The operators, in order."""
        return operator_catalogue(self.n_operators, self.seed)

    def entries(self) -> tuple[tuple[str, str, str, int], ...]:
        """Return id, surface, operator and repetition (from 1) of each recording, surface by surface."""
        operators = self.operators
        return tuple(
            (f"{surface.name}-{k:02d}", surface.name, operators[(k - 1) % self.n_operators].name, k)
            for surface in self.surfaces
            for k in range(1, self.n_recordings + 1)
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
                f"no recording (surface {surface_index}, repetition {repetition}). Expected surface "
                f"0..{self.n_surfaces - 1}, repetition 1..{self.n_recordings}"
            )
        from texclass.simulate.freehand import record_freehand  # numba: not to say what a dataset holds

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
        """Return a hex digest that changes with the recipe and with the code of the simulation."""
        return hashlib.sha256(f"{self!r} {code_hash('simulate', words=False)}".encode()).hexdigest()
