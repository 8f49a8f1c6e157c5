"""A planned scene, kept in one file, and being felt: several contacts, one sample per call, no click."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.haptics.exchange.texture_file import read_object, write_object
from texclass.haptics.scene import render_kernels as kernels
from texclass.haptics.scene.render_kernels import NONE, Column, Fact, Phase, State
from texclass.haptics.textures.contract import Serializable
from texclass.haptics.textures.grid import GridModel, update_interval
from texclass.recording import Samples
from texclass.signals import positive

MOST_CONTACTS = 1000

FADE_S = 0.02
"""Duration of the crossfade where a contact begins, ends, or meets another model."""
STILL = 0.25
"""Below this part of the slowest speed of a model it fades linearly to silence at rest."""
PEAK_FACTOR = 3.0
"""No rendered sample exceeds this times the largest recorded one (sqrt(2) of it within a crossfade)."""


@dataclass(frozen=True, eq=False)
class PlannedScene(Serializable):
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
            raise ValueError(f"band is {self.band_hz} Hz, fs {self.fs} Hz. Expected 0 <= low < high <= fs/2")
        positive(self.largest_output, "largest output")
        if not 1 <= self.contacts <= MOST_CONTACTS:
            raise ValueError(f"contacts are {self.contacts!r:.40}. Expected 1 to {MOST_CONTACTS}")
        if not self.assigned or any(not 0 <= i < len(self.models) for i in self.assigned.values()):
            raise ValueError(
                f"surfaces have models {list(self.assigned.values())} of {len(self.models)}. "
                "Expected a surface at least, each with one of the models"
            )
        odd = [model for model in self.models if (len(model.axes), model.scale) != (2, "log")]
        if odd:
            found = f"{len(odd[0].axes)} axes, scale {odd[0].scale!r}"
            raise ValueError(f"a model has {found}. Expected speed and force, 'log'")

    def index_of(self, surface: str) -> int:
        """Return which model a surface has."""
        if surface not in self.assigned:
            raise ValueError(f"surface is {surface!r}. Expected one of {', '.join(self.assigned)}")
        return self.assigned[surface]

    def model_of(self, surface: str) -> GridModel:
        """Return the model of a surface."""
        return self.models[self.index_of(surface)]

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
        return write_object(self, path, unit=self.unit)


def load_scene(path: str | Path) -> PlannedScene:
    """Return the planned scene of a file, as `texclass scene plan` or `PlannedScene.save` wrote it.

    Raises
    ------
    ValueError
        If the file is damaged, breaks a rule, or holds no scene; the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    scene: PlannedScene = read_object(path, {PlannedScene.family: PlannedScene})
    return scene


def packed(scene: PlannedScene) -> tuple[Samples, NDArray[np.int64]]:
    """Return `bank` and `index` of a scene, as `render_kernels` tells: what a loop over samples plays."""
    facts = np.empty(len(Fact))
    facts[Fact.GLIDE] = -np.expm1(-1 / (0.01 * scene.fs))  # speed and force of the hand are followed in 10 ms
    facts[Fact.HOP] = update_interval(scene.fs)
    facts[Fact.FADE] = max(2, round(FADE_S * scene.fs))
    facts[Fact.STILL] = STILL
    facts[Fact.RADIANS] = 2 * np.pi / scene.fs
    facts[Fact.OUTPUT] = scene.largest_output
    index, parts = np.zeros((len(scene.models), len(Column)), dtype=np.int64), [facts]
    for row, model in zip(index, scene.models, strict=True):
        row[: Column.AT_SPEEDS] = model.n_lines, model.order, *model.n_nodes
        bounds = np.array([model.speeds[0], model.forces[0], PEAK_FACTOR * model.peak])
        course = np.concatenate([model.frequency_hz, model.per_mm])
        arrays = *model.nodes.axes, model.rows, model.nodes.values[:, -1], course, bounds
        begins = np.cumsum([0, *(array.size for array in arrays)]) + sum(part.size for part in parts)
        row[Column.AT_SPEEDS :] = begins[:-1]
        parts += [array.ravel() for array in arrays]
    return np.concatenate(parts), index


class SceneRenderer:
    """Plays a planned scene, sample by sample.

    Every contact is a finger or a tool of its own: it touches one surface at a time, or none, and has its own
    noise, so that the others do not change what it feels.

    Parameters
    ----------
    scene : PlannedScene
    n_contacts : int, optional
        The scene's by default.
    seed : int
        Of the noise.

    Attributes
    ----------
    fs : float
        Hz.
    motion : ndarray of shape (n_contacts, 3)
        To be written before `step_all`: speed x and y (mm/s) and force (N) of each contact.
    out : ndarray of shape (n_contacts,)
        What `step_all` fills.

    Notes
    -----
    Everything is allocated here: what `step` and `step_all` do grows no memory, however long they go on.
    Compilation is done here too, not in the first sample.

    Examples
    --------
    >>> from texclass.haptics.scene import SceneRenderer, plan_scene
    >>> renderer = SceneRenderer(plan_scene("example").scene)  # doctest: +SKIP
    >>> renderer.touch(0, "wood")  # doctest: +SKIP
    >>> renderer.step(0, 80.0, 0.0, 1.0)  # doctest: +SKIP
    """

    def __init__(self, scene: PlannedScene, *, n_contacts: int | None = None, seed: int = 0) -> None:
        n = scene.contacts if n_contacts is None else n_contacts
        if n < 1:
            raise ValueError(f"n_contacts is {n}. Expected at least 1")
        self.fs, self.n_contacts, self._seed = scene.fs, n, seed
        self._scene = scene
        bank, index = packed(scene)
        columns = max(model.rows.shape[-1] for model in scene.models)
        self._state = np.zeros((n, State.VOICES + 6 * (columns + 1)))
        self._phase = np.zeros((n, len(Phase)), dtype=np.int64)
        self._arrays = bank, index, self._state, self._phase
        self.motion, self.out = self._state[:, : State.OUT], self._state[:, State.OUT]
        self.reset()
        # Compile, or load what was compiled, before the first sample is due.
        self.step(0, 0.0, 0.0, 0.0)
        self.step_all()
        self.process(np.zeros((n, 1, 2)), np.zeros((n, 1)))
        self.reset()

    @property
    def n_bytes(self) -> int:
        """Of all that it holds."""
        return sum(array.nbytes for array in self._arrays)

    def reset(self) -> None:
        """Lift all contacts, with the random numbers of the first sample."""
        self._state[:, State.SPEED :] = 0.0
        self._phase[:] = 0
        self._phase[:, [Phase.MODEL, Phase.OTHER, Phase.WANTED]] = NONE
        seeds = np.random.SeedSequence(self._seed).generate_state(self.n_contacts, np.uint64)
        self._phase[:, Phase.NOISE] = seeds.view(np.int64)

    def touch(self, contact: int, surface: str | None) -> None:
        """Let a contact begin on a surface, pass to another one, or end (None), from the next sample on."""
        self._phase[self._checked(contact), Phase.WANTED] = self._model(surface)

    def step(self, contact: int, speed_x: float, speed_y: float, force: float) -> float:
        """Return the next sample of one contact, in the unit of the recordings.

        Parameters
        ----------
        contact : int
            0 ... n_contacts - 1.
        speed_x, speed_y : float
            Tangential, mm/s.
        force : float
            Normal, N; 0 or less fades out.

        Raises
        ------
        ValueError
            For NaN or infinity; the state stays as it was.
        """
        if not 0 <= contact < self.n_contacts:
            self._checked(contact)
        x: float = kernels.step(*self._arrays, contact, float(speed_x), float(speed_y), float(force))
        if x != x:  # noqa: PLR0124  NaN, and nothing is cheaper to ask
            raise ValueError(f"speed and force are {(speed_x, speed_y, force)}. Expected finite numbers")
        return x

    def step_all(self) -> Samples:
        """Return `out`, filled with the next sample of every contact, whose speeds and force are in `motion`.

        What `step` returns for each of them, in one call.

        Raises
        ------
        ValueError
            If `motion` holds NaN or infinity: that contact stays as it was.
        """
        if not kernels.step_all(*self._arrays):
            raise ValueError(f"motion is {self.motion.tolist()}. Expected finite numbers")
        return self.out

    def process(
        self,
        velocity: ArrayLike,
        force: ArrayLike,
        surfaces: Sequence[Sequence[str | None]] | None = None,
        *,
        out: Samples | None = None,
    ) -> Samples:
        """Return the next samples of all contacts: bit for bit what single steps return, however it is cut.

        Parameters
        ----------
        velocity : array_like of shape (n_contacts, n, 2)
            mm/s.
        force : array_like of shape (n_contacts, n)
            N.
        surfaces : sequence of shape (n_contacts, n), optional
            What each contact touches at each sample; by default what `touch` said last.
        out : ndarray of shape (n_contacts, n), optional
            Filled and returned; a new one by default.

        Raises
        ------
        ValueError
            For wrong shapes, unknown surfaces, NaN or infinity.
        """
        v, f = np.asarray(velocity, dtype=np.float64), np.asarray(force, dtype=np.float64)
        if f.ndim != 2 or len(f) != self.n_contacts or v.shape != (*f.shape, 2):
            raise ValueError(
                f"velocity has shape {v.shape}, force {f.shape}. Expected ({self.n_contacts}, n, 2) "
                f"and ({self.n_contacts}, n)"
            )
        if not (np.isfinite(v).all() and np.isfinite(f).all()):
            raise ValueError("velocity or force holds NaN or infinity. Expected finite numbers")
        wanted = np.zeros((0, 0), dtype=np.int64)
        if surfaces is not None:
            model = {name: self._model(name) for name in {name for row in surfaces for name in row}}
            wanted = np.array([[model[name] for name in row] for row in surfaces], dtype=np.int64)
            if wanted.shape != f.shape:
                raise ValueError(f"surfaces have shape {wanted.shape}. Expected {f.shape}, as the force")
        found = np.empty(f.shape) if out is None else out
        kernels.play(*self._arrays, v, f, wanted, found)
        return found

    def _model(self, surface: str | None) -> int:
        return NONE if surface is None else self._scene.index_of(surface)

    def _checked(self, contact: int) -> int:
        if not 0 <= contact < self.n_contacts:
            raise ValueError(f"contact is {contact}. Expected 0 ... {self.n_contacts - 1}")
        return contact


@dataclass(frozen=True, eq=False)
class SceneSurface:
    """One surface of a planned scene, played alone as a texture is.

    Parameters
    ----------
    scene : PlannedScene
    name : str
        Of the surface.

    Raises
    ------
    ValueError
        If the scene has no such surface.
    """

    scene: PlannedScene
    name: str

    def __post_init__(self) -> None:
        self.scene.model_of(self.name)

    @property
    def fs(self) -> float:
        """Of the device, Hz."""
        return self.scene.fs

    @property
    def speeds(self) -> Samples:
        """For which it was planned, mm/s."""
        return self.scene.model_of(self.name).speeds

    @property
    def forces(self) -> Samples:
        """For which it was planned, N."""
        return self.scene.model_of(self.name).forces

    def renderer(self, *, seed: int = 0) -> "OneContact":
        """Return a renderer at rest; the seed is that of the noise."""
        return OneContact(self, seed)


class OneContact:
    """A contact that stays on a surface of a scene; see `texclass.haptics.textures.Renderer`."""

    def __init__(self, surface: SceneSurface, seed: int) -> None:
        self.fs, self._name = surface.fs, surface.name
        self._renderer = SceneRenderer(surface.scene, n_contacts=1, seed=seed)
        self.reset()

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path; the position is not used."""
        played = self._renderer.process(np.asarray(velocity)[np.newaxis], np.asarray(force)[np.newaxis])
        return np.asarray(played[0])

    def reset(self) -> None:
        """Return to rest, with the random numbers of the first sample."""
        self._renderer.reset()
        self._renderer.touch(0, self._name)
