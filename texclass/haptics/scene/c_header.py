"""Write planned scenes as C headers, for devices that render them with `c/texclass_render.h`.

A header contains the arrays of `build_kernel_arrays` as constants. `texclass_render.h` contains the functions
of `render_kernels` in C99, and is written next to the header.
"""

import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path

import numpy as np

from texclass._version import __version__
from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.scene.pages import tap_modes
from texclass.haptics.scene.renderer import PlannedScene, build_kernel_arrays
from texclass.vibration import DecayingModes, TapModel

RENDERER = "texclass_render.h"
"""File name of the renderer, which the headers include."""
ARRAYS = "bank", "index", "models", "tap_modes", "first_mode"
"""Arrays of a header, in the order of the members of `texclass_scene`."""


def c_header(
    scene: PlannedScene, name: str, *, taps: Mapping[str, TapModel | DecayingModes] | None = None
) -> str:
    """Return a C header with the models of a scene as constants.

    Parameters
    ----------
    scene : PlannedScene
        Scene to write.
    name : str
        Name of the scene in C. Characters that C does not allow become underscores.
    taps : mapping of str to TapModel or DecayingModes, optional
        Tap of each surface, in the unit of the scene; `DecayingModes` describe a tap at 0.1 m/s (default: no
        taps).

    Returns
    -------
    str
        Header, which includes `texclass_render.h`.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.haptics.scene import PlannedScene
    >>> from texclass.haptics.textures.grid import GridModel
    >>> model = GridModel(([40.0, 160.0], [1.0]), np.full((2, 1, 1), 0.5), [[1.0], [4.0]], 8.0)
    >>> scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (model,))
    >>> "enum { DESK_OAK = 0, DESK_N_SURFACES = 1 };" in c_header(scene, "desk")
    True
    """
    bank, index = build_kernel_arrays(scene)
    width = max(model.rows.shape[-1] for model in scene.models)
    modes = [tap_modes(taps[surface]) if taps and surface in taps else [] for surface in scene.model_indices]
    first_mode = np.cumsum([0, *map(len, modes)])
    variable = c_name(name)
    prefix = variable.upper()
    names = unique_c_names(f"{prefix}_{c_name(surface).upper()}" for surface in scene.model_indices)
    surfaces = [f"{c} = {i}" for i, c in enumerate(names)]
    seed = np.random.SeedSequence(0).generate_state(1, np.uint64)[0]
    rows = [value for surface in modes for row in surface for value in row] or [0.0]
    legend = [f"{c}: {surface}" for c, surface in zip(names, scene.model_indices, strict=True)]
    return "\n".join([
        f"/* {comment(scene.name or name)}: {scene.fs:g} Hz, {scene.unit}. Writer: texclass {__version__}.",
        *(f"   {comment(line)}" for line in legend),
        "   Usage: see texclass_render.h. */",
        f"#ifndef {prefix}_H",
        f"#define {prefix}_H",
        "",
        f'#include "{RENDERER}"',
        "",
        f"#define {prefix}_VOICES {6 * (width + 1)} /* doubles of the voices of one contact */",
        f"#define {prefix}_SEED UINT64_C({seed:#x}) /* noise of SceneRenderer(seed=0), contact 0 */",
        f"enum {{ {', '.join(surfaces)}, {prefix}_N_SURFACES = {len(names)} }};",
        "",
        c_array("double", f"{variable}_bank", map(repr, bank.tolist())),
        c_array("int32_t", f"{variable}_index", map(str, index.ravel().tolist())),
        c_array("int32_t", f"{variable}_models", map(str, scene.model_indices.values())),
        c_array("double", f"{variable}_tap_modes", map(repr, rows)),
        c_array("int32_t", f"{variable}_first_mode", map(str, first_mode.tolist())),
        f"static const texclass_scene {variable}_scene = {{",
        f"  {scene.fs!r}, {len(names)}, {width}, {', '.join(f'{variable}_{array}' for array in ARRAYS)}",
        "};",
        "",
        "#endif",
        "",
    ])  # fmt: skip


def write_c_header(
    path: str | Path, scene: PlannedScene, *, taps: Mapping[str, TapModel | DecayingModes] | None = None
) -> tuple[Path, Path]:
    """Write the header of `c_header`, and `texclass_render.h` into the same folder.

    Parameters
    ----------
    path : str or Path
        File name ending in `.h`. Its stem is the name of the scene in C.
    scene, taps
        Arguments of `c_header`.

    Returns
    -------
    (Path, Path)
        Paths of the header and of the renderer.

    Raises
    ------
    ValueError
        If the name does not end in `.h`, or is that of the renderer.

    Examples
    --------
    >>> import tempfile
    >>> from texclass.haptics.scene import PlannedScene, write_c_header
    >>> from texclass.haptics.textures.grid import GridModel
    >>> scene = PlannedScene(
    ...     "desk", 1000.0, "m/s^2", (20.0, 450.0), 30.0, 1, {"oak": 0}, (GridModel.silence(),)
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_c_header(f"{folder}/desk.h", scene)]
    ['desk.h', 'texclass_render.h']
    """
    path = check_suffix(path, ".h")
    if path.name == RENDERER:
        raise ValueError(f"{path} is the name of the renderer itself. Choose another name for the texture")
    renderer = path.with_name(RENDERER)
    write_atomic(path, c_header(scene, path.stem, taps=taps).encode())
    write_atomic(renderer, files(__package__).joinpath("c", RENDERER).read_bytes())
    return path, renderer


def c_name(text: str) -> str:
    """Return a text as the beginning of names in C: letters, digits and underscores."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_") or "surface"
    return f"t_{name}" if name[0].isdigit() or name.lower().startswith("texclass") else name


def unique_c_names(names: Iterable[str]) -> list[str]:
    """Return names, of which repeated ones end in _2, _3, ..."""
    unique: list[str] = []
    for name in names:
        candidates = (name, *(f"{name}_{i}" for i in range(2, len(unique) + 3)))
        unique.append(next(candidate for candidate in candidates if candidate not in unique))
    return unique


def comment(text: str) -> str:
    """Return a text that does not end or open a comment of C."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")


def c_array(kind: str, name: str, values: Iterable[str]) -> str:
    """Return the definition of a constant array, with four values per line."""
    items = list(values)
    lines = [", ".join(items[i : i + 4]) for i in range(0, len(items), 4)]
    return f"static const {kind} {name}[{len(items)}] = {{\n  " + ",\n  ".join(lines) + "\n};"
