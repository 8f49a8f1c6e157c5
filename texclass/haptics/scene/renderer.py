"""Define planned scenes, their file format, and a click-free renderer for several contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.haptics.exchange.texture_file import read_object, write_object
from texclass.haptics.scene import render_kernels as kernels
from texclass.haptics.scene.render_kernels import NO_MODEL, Column, Constant, State, Status
from texclass.haptics.textures.contract import Serializable
from texclass.haptics.textures.grid import GridModel, update_interval
from texclass.haptics.textures.motion_renderer import check_path, describe_refused
from texclass.recording import Samples
from texclass.signals import positive

MAX_CONTACTS = 1000

FADE_S = 0.02
"""Duration of the crossfade when a contact begins, ends or changes its model, in s."""
SMOOTHING_S = 0.01
"""Time constant of the smoothing of speed and force, in s."""
REST_RATIO = 0.25
"""Fraction of the slowest speed of a model below which the output fades linearly to silence."""
PEAK_FACTOR = 3.0
"""Limit of rendered samples relative to the largest recorded sample (sqrt(2) times more in a crossfade)."""


@dataclass(frozen=True, eq=False)
class PlannedScene(Serializable):
    """Models of all surfaces of a scene, as selected by `plan_scene` and ready to render.

    Parameters
    ----------
    name : str
        Name of the scene.
    fs : float
        Sampling rate of the device in Hz.
    unit : str
        Unit of the vibration.
    band_hz : (float, float)
        Frequency range of the device in Hz.
    largest_output : float
        Limit of the output in `unit`.
    contacts : int
        Number of simultaneous contacts.
    model_indices : mapping of str to int
        Surface -> index of its model. Several surfaces can share a model.
    models : sequence of GridModel
        Models with the axes speed and force and scale "log".

    Raises
    ------
    ValueError
        If a parameter is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import PlannedScene
    >>> from texclass.haptics.textures.grid import GridModel
    >>> model = GridModel(([40.0, 160.0], [1.0]), np.full((2, 1, 1), 0.5), [[1.0], [4.0]], 8.0)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (model,))
    >>> scene.model_of("oak").order
    1
    """

    family: ClassVar[str] = "scene"
    name: str
    fs: float
    unit: str
    band_hz: tuple[float, float]
    largest_output: float
    contacts: int
    model_indices: Mapping[str, int]
    models: tuple[GridModel, ...]

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not (0 <= low < high <= self.fs / 2 and np.isfinite(self.fs)):
            raise ValueError(
                f"band_hz must increase and end at or below fs / 2, got {self.band_hz} Hz at fs {self.fs} Hz"
            )
        positive(self.largest_output, "largest output")
        if not 1 <= self.contacts <= MAX_CONTACTS:
            raise ValueError(f"contacts must be between 1 and {MAX_CONTACTS}, got {self.contacts!r:.40}")
        indices = list(self.model_indices.values())
        if not indices or any(not 0 <= i < len(self.models) for i in indices):
            raise ValueError(f"model_indices must be between 0 and {len(self.models) - 1}, got {indices}")
        for model in self.models:
            if (len(model.axes), model.scale) != (2, "log"):
                raise ValueError(
                    "models must have the axes speed and force and scale 'log', got "
                    f"{len(model.axes)} axes and scale {model.scale!r}"
                )

    @classmethod
    def of_model(cls, name: str, fs: float, unit: str, model: GridModel) -> "PlannedScene":
        """Return a scene with one contact and one surface, whose output only the model limits.

        Parameters
        ----------
        name : str
            Name of the scene and of its surface.
        fs : float
            Sampling rate in Hz.
        unit : str
            Unit of the vibration.
        model : GridModel
            Model of the surface.
        """
        band = min(20.0, 0.1 * fs), 0.45 * fs
        return cls(name, fs, unit, band, 1e6, 1, {name: 0}, (model,))

    def index_of(self, surface: str) -> int:
        """Return the index of the model of a surface."""
        if surface not in self.model_indices:
            raise ValueError(f"surface must be one of {', '.join(self.model_indices)}, got {surface!r}")
        return self.model_indices[surface]

    def model_of(self, surface: str) -> GridModel:
        """Return the model of a surface."""
        return self.models[self.index_of(surface)]

    @property
    def n_bytes(self) -> int:
        """Memory of the models in bytes."""
        return sum(model.n_bytes for model in self.models)

    @property
    def operations(self) -> float:
        """Mean number of multiplications and additions per sample of one contact, over the surfaces."""
        return float(np.mean([self.model_of(name).operations(self.fs) for name in self.model_indices]))

    def save(self, path: str | Path) -> Path:
        """Write the scene to a `.texture` file."""
        return write_object(self, path, unit=self.unit)


def load_scene(path: str | Path) -> PlannedScene:
    """Load a planned scene from a `.texture` file.

    Parameters
    ----------
    path : str or Path
        File that `texclass scene plan` or `PlannedScene.save` wrote.

    Returns
    -------
    PlannedScene
        The scene of the file.

    Raises
    ------
    ValueError
        If the file is damaged, invalid or contains no scene.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> from texclass.haptics.scene import PlannedScene, load_scene
    >>> from texclass.haptics.textures.grid import GridModel
    >>> scene = PlannedScene(
    ...     "desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (GridModel.silence(),)
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load_scene(scene.save(f"{folder}/desk.texture")).model_indices
    {'oak': 0}
    """
    scene: PlannedScene = read_object(path, {PlannedScene.family: PlannedScene})
    return scene


def build_kernel_arrays(scene: PlannedScene) -> tuple[Samples, NDArray[np.int64]]:
    """Return the arrays `bank` and `index` of a scene, as `render_kernels` defines them."""
    constants = np.empty(len(Constant))
    constants[Constant.SMOOTHING] = -np.expm1(-1 / (SMOOTHING_S * scene.fs))
    constants[Constant.UPDATE_INTERVAL] = update_interval(scene.fs)
    constants[Constant.FADE_SAMPLES] = max(2, round(FADE_S * scene.fs))
    constants[Constant.REST_RATIO] = REST_RATIO
    constants[Constant.RADIANS_PER_HZ] = 2 * np.pi / scene.fs
    constants[Constant.OUTPUT_LIMIT] = scene.largest_output
    index, blocks = np.zeros((len(scene.models), len(Column)), dtype=np.int64), [constants]
    for row, model in zip(index, scene.models, strict=True):
        row[: Column.SPEED_OFFSET] = model.n_lines, model.order, *model.n_nodes
        bounds = np.array([model.speeds[0], model.forces[0], PEAK_FACTOR * model.peak])
        lines = np.concatenate([model.frequency_hz, model.per_mm])
        arrays = *model.nodes.axes, model.rows, model.nodes.values[:, -1], lines, bounds
        sizes = np.cumsum([0, *(array.size for array in arrays)])
        row[Column.SPEED_OFFSET :] = sizes[:-1] + sum(block.size for block in blocks)
        blocks += [array.ravel() for array in arrays]
    return np.concatenate(blocks), index


class SceneRenderer:
    """Real-time renderer of a planned scene, one sample per call.

    Every contact represents one finger or tool, which touches at most one surface at a time. Contacts are
    independent: each has its own noise.

    Parameters
    ----------
    scene : PlannedScene
        Scene to render.
    n_contacts : int, optional
        Number of contacts (default: `scene.contacts`).
    seed : int
        Seed of the noise (default 0).

    Attributes
    ----------
    fs : float
        Sampling rate in Hz.
    n_contacts : int
        Number of contacts.
    motion : ndarray of shape (n_contacts, 3)
        Input of `step_all`: velocity along x and y (mm/s) and force (N) of each contact.
    output : ndarray of shape (n_contacts,)
        Output of `step_all`.

    Raises
    ------
    ValueError
        If `n_contacts` is below 1.

    Notes
    -----
    The constructor allocates all memory and compiles all functions. The first sample is therefore as fast as
    all later ones, and `step` and `step_all` allocate no memory.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import PlannedScene, SceneRenderer
    >>> from texclass.haptics.textures.grid import GridModel
    >>> model = GridModel(([40.0, 160.0], [1.0]), np.full((2, 1, 1), 0.5), [[1.0], [4.0]], 8.0)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (model,))
    >>> renderer = SceneRenderer(scene)
    >>> renderer.touch(0, "oak")
    >>> abs(renderer.step(0, 80.0, 0.0, 1.0)) < 30.0
    True
    """

    def __init__(self, scene: PlannedScene, *, n_contacts: int | None = None, seed: int = 0) -> None:
        n = scene.contacts if n_contacts is None else n_contacts
        if n < 1:
            raise ValueError(f"n_contacts must be at least 1, got {n}")
        self.fs, self.n_contacts, self._seed = scene.fs, n, seed
        self._scene = scene
        bank, index = build_kernel_arrays(scene)
        columns = max(model.rows.shape[-1] for model in scene.models)
        self._state = np.zeros((n, State.VOICES + 6 * (columns + 1)))
        self._status = np.zeros((n, len(Status)), dtype=np.int64)
        self._arrays = bank, index, self._state, self._status
        self.motion, self.output = self._state[:, : State.OUTPUT], self._state[:, State.OUTPUT]
        self.reset()
        # Compile the functions, or load the compiled code, before the first sample is due.
        self.step(0, 0.0, 0.0, 0.0)
        self.step_all()
        self.process(np.zeros((n, 1, 2)), np.zeros((n, 1)))
        self.reset()

    @property
    def n_bytes(self) -> int:
        """Memory of all arrays in bytes."""
        return sum(array.nbytes for array in self._arrays)

    def reset(self) -> None:
        """End all contacts and restart the noise."""
        self._state[:, State.SPEED :] = 0.0
        self._status[:] = 0
        self._status[:, [Status.MODEL, Status.PREVIOUS, Status.NEXT]] = NO_MODEL
        seeds = np.random.SeedSequence(self._seed).generate_state(self.n_contacts, np.uint64)
        self._status[:, Status.NOISE] = seeds.view(np.int64)

    def touch(self, contact: int, surface: str | None) -> None:
        """Move a contact to another surface from the next sample on, or end the contact (None).

        Raises
        ------
        ValueError
            If the contact or the surface does not exist.
        """
        self._status[self._check_contact(contact), Status.NEXT] = self._model_index(surface)

    def step(self, contact: int, speed_x: float, speed_y: float, force: float) -> float:
        """Return the next sample of one contact.

        Parameters
        ----------
        contact : int
            Index of the contact, 0 ... n_contacts - 1.
        speed_x, speed_y : float
            Tangential velocity in mm/s.
        force : float
            Normal force in N. At 0 or below, the output fades to silence.

        Returns
        -------
        float
            Vibration in the unit of the scene.

        Raises
        ------
        ValueError
            If an input is NaN or exceeds `MAX_INPUT` (1e9 mm/s or N); the state does not change.
        """
        if not 0 <= contact < self.n_contacts:
            self._check_contact(contact)
        x: float = kernels.step(*self._arrays, contact, float(speed_x), float(speed_y), float(force))
        if x != x:  # noqa: PLR0124  the fastest test for NaN
            raise ValueError(describe_refused(np.array([speed_x, speed_y]), np.array(force)))
        return x

    def step_all(self) -> Samples:
        """Render the next sample of every contact from `motion` into `output`.

        The samples are the same as with one call of `step` per contact.

        Returns
        -------
        ndarray of shape (n_contacts,)
            The attribute `output`, which the next call overwrites.

        Raises
        ------
        ValueError
            If `motion` contains NaN or a value above `MAX_INPUT` (1e9 mm/s or N); the state of the affected
            contacts does not change.
        """
        if not kernels.step_all(*self._arrays):
            raise ValueError(describe_refused(self.motion[:, :2], self.motion[:, 2]))
        return self.output

    def process(
        self,
        velocity: ArrayLike,
        force: ArrayLike,
        surfaces: Sequence[Sequence[str | None]] | None = None,
        *,
        out: Samples | None = None,
    ) -> Samples:
        """Return the next block of samples of all contacts. The samples are identical to those of `step`.

        Parameters
        ----------
        velocity : array_like of shape (n_contacts, n, 2)
            Tangential velocity in mm/s.
        force : array_like of shape (n_contacts, n)
            Normal force in N.
        surfaces : sequence of shape (n_contacts, n), optional
            Surface of each contact at each sample (default: the surfaces set by `touch`).
        out : ndarray of shape (n_contacts, n), optional
            Output array (default: a new array).

        Returns
        -------
        ndarray of shape (n_contacts, n)
            Vibration in the unit of the scene.

        Raises
        ------
        ValueError
            If a shape does not match, a surface is unknown, or an input is NaN or exceeds `MAX_INPUT` (1e9
            mm/s or N); the state does not change.
        """
        v, f = np.asarray(velocity, dtype=np.float64), np.asarray(force, dtype=np.float64)
        if f.ndim != 2 or len(f) != self.n_contacts or v.shape != (*f.shape, 2):
            raise ValueError(
                f"velocity and force must have shapes ({self.n_contacts}, n, 2) and ({self.n_contacts}, n), "
                f"got {v.shape} and {f.shape}"
            )
        check_path(v.reshape(-1, 2), f.reshape(-1))
        models = np.zeros((0, 0), dtype=np.int64)
        if surfaces is not None:
            indices = {name: self._model_index(name) for name in {name for row in surfaces for name in row}}
            models = np.array([[indices[name] for name in row] for row in surfaces], dtype=np.int64)
            if models.shape != f.shape:
                raise ValueError(f"surfaces must have the shape of force, {f.shape}, got {models.shape}")
        output = np.empty(f.shape) if out is None else out
        kernels.render_block(*self._arrays, v, f, models, output)
        return output

    def _model_index(self, surface: str | None) -> int:
        return NO_MODEL if surface is None else self._scene.index_of(surface)

    def _check_contact(self, contact: int) -> int:
        if not 0 <= contact < self.n_contacts:
            raise ValueError(f"contact must be between 0 and {self.n_contacts - 1}, got {contact}")
        return contact


@dataclass(frozen=True, eq=False)
class SceneSurface:
    """One surface of a planned scene, with the same interface as a texture.

    Parameters
    ----------
    scene : PlannedScene
        Planned scene.
    name : str
        Name of the surface.

    Raises
    ------
    ValueError
        If the scene has no such surface.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import PlannedScene, SceneSurface
    >>> from texclass.haptics.textures.grid import GridModel
    >>> model = GridModel(([40.0, 160.0], [1.0]), np.full((2, 1, 1), 0.5), [[1.0], [4.0]], 8.0)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (model,))
    >>> surface = SceneSurface(scene, "oak")
    >>> surface.renderer().process(np.full((100, 2), 80.0), np.ones(100)).shape
    (100,)
    """

    scene: PlannedScene
    name: str

    def __post_init__(self) -> None:
        self.scene.model_of(self.name)

    @property
    def fs(self) -> float:
        """Sampling rate in Hz."""
        return self.scene.fs

    @property
    def speeds(self) -> Samples:
        """Speeds of the nodes in mm/s."""
        return self.scene.model_of(self.name).speeds

    @property
    def forces(self) -> Samples:
        """Forces of the nodes in N."""
        return self.scene.model_of(self.name).forces

    def renderer(self, *, seed: int = 0) -> "SurfaceRenderer":
        """Return a renderer without motion.

        Parameters
        ----------
        seed : int
            Seed of the noise (default 0).

        Returns
        -------
        SurfaceRenderer
            Renderer of this surface.
        """
        return SurfaceRenderer(self, seed)


class SurfaceRenderer:
    """Renderer of one contact on one surface of a scene; see `texclass.haptics.textures.Renderer`."""

    def __init__(self, surface: SceneSurface, seed: int) -> None:
        self.fs, self._name = surface.fs, surface.name
        self._renderer = SceneRenderer(surface.scene, n_contacts=1, seed=seed)
        self.reset()

    def process(self, velocity: ArrayLike, force: ArrayLike, position: ArrayLike | None = None) -> Samples:
        """Return the vibration for the next samples of a path; `position` is ignored."""
        output = self._renderer.process(np.asarray(velocity)[np.newaxis], np.asarray(force)[np.newaxis])
        return np.asarray(output[0])

    def reset(self) -> None:
        """Reset the motion and restart the noise."""
        self._renderer.reset()
        self._renderer.touch(0, self._name)
