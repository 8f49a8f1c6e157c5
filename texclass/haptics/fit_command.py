"""Command that fits a texture to recordings: texture fit."""

import re
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument

from texclass.cli import parameters as p
from texclass.cli.output import SCENE_KERNELS, announce_start, print_lines, write_json

if TYPE_CHECKING:
    from texclass.recording import Recording

SPEED_UNITS = {"mm/s": 1.0, "cm/s": 10.0, "m/s": 1000.0}
FORCE_UNITS = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3}
"""Factors from units of speed to mm/s, and of force to N."""


@p.with_reader_options
def fit(
    recordings: Annotated[
        list[str],
        Argument(help="Recordings of one surface, with speed and force: files, or DATASET:RECORDING."),
    ],
    *,
    speed_column: Annotated[
        str, p.data_option(metavar="COLUMN", help="Column of the speed, by name or number.")
    ] = "speed",
    force_column: Annotated[
        str, p.data_option(metavar="COLUMN", help="Column of the normal force, by name or number.")
    ] = "normal_force",
    position_columns: Annotated[
        str | None,
        p.data_option(metavar="COLUMNS", help="Columns of the position in mm, e.g. x,y, instead of a speed."),
    ] = None,
    speed_unit: Annotated[
        str | None,
        p.data_option(
            metavar="UNIT", help="Unit of the speed: mm/s, cm/s or m/s (default: as in the column, or mm/s)."
        ),
    ] = None,
    force_unit: Annotated[
        str | None,
        p.data_option(
            metavar="UNIT", help="Unit of the force: N, mN or gf (default: as in the column, or N)."
        ),
    ] = None,
    reader: p.Reader,
    output: Annotated[
        Path,
        p.output_file(
            "--output",
            "-o",
            suffixes=[".texture"],
            help="Texture to write; its stem is the name of the surface.",
        ),
    ],
    page: Annotated[
        bool,
        p.output_option(
            "--page",
            help="Also write a page (.html next to the texture) on which you can stroke and hear it.",
        ),
    ] = False,
    json_file: p.JsonFile = None,
) -> None:
    """Fit a texture that follows speed and force to recordings of one surface.

    The size of the model is selected on held-out halves of the recordings. The
    errors are printed next to those of a texture that ignores speed and force.
    """
    announce_start(*SCENE_KERNELS)
    from texclass.haptics.exchange import save_texture
    from texclass.haptics.scene import PlannedScene, fit_recordings, write_scene_page
    from texclass.reporting import print_document

    units = {"speed": speed_unit, "normal_force": force_unit}
    columns = {"speed": speed_column, "normal_force": force_column}
    loaded = [load_motion(name, reader, columns, units, position_columns) for name in recordings]
    result = fit_recordings(loaded, name=output.stem)
    write_json(json_file, result.to_json())
    flags = dict.fromkeys(flag for one in loaded for flag in one.flags)
    print_lines("note:", (flag for flag in flags if not flag.startswith("outliers:")))  # in the result
    print_document(result.document())
    texture = result.texture
    written = [save_texture(texture, output, unit=result.unit)]
    if page:
        planned = PlannedScene.of_model(texture.name, texture.fs, result.unit, texture.grid)
        written.append(write_scene_page(output.with_suffix(".html"), planned))
    for path in written:
        typer.echo(f"wrote {path}, {path.stat().st_size} bytes")


def load_motion(
    recording_name: str,
    reader: dict[str, Any],
    columns: dict[str, str],
    units: dict[str, str | None],
    position_columns: str | None,
) -> "Recording":
    """Load a recording with speed in mm/s and normal force in N.

    Parameters
    ----------
    recording_name : str
        File with columns, or DATASET:RECORDING, whose card defines the columns.
    reader : dict
        Keyword arguments of `load_recording`.
    columns, units : dict
        Column and unit of `speed` and `normal_force`; a unit of None is that of the column name.
    position_columns : str or None
        Columns of the position in mm, which replace the speed.
    """
    from texclass.loaders import find_recording, load_recording
    from texclass.loaders.columns import resolve_columns, split_columns
    from texclass.loaders.files import column_names
    from texclass.loaders.readers import ReaderSettings

    path = Path(recording_name)
    if ":" in recording_name and not path.exists():
        return find_recording(recording_name, **reader)
    names = column_names(
        path, ReaderSettings(**reader | {"drop_incomplete": bool(reader["drop_incomplete"])})
    )
    auxiliary, factors = {}, {}
    for signal, factor_of in (("speed", SPEED_UNITS), ("normal_force", FORCE_UNITS)):
        if signal == "speed" and position_columns is not None:
            continue
        (name,) = resolve_columns((columns[signal],), names)
        option = f"--{signal.removeprefix('normal_')}-column"
        auxiliary[signal] = _check_column(path, name, option, names)
        in_name = re.search(r"[\[(]([^\])]+)[\])]\s*$", name)
        unit = units[signal] or (in_name[1].strip() if in_name else next(iter(factor_of)))
        if unit not in factor_of:
            raise ValueError(
                f"{path}: the unit of column {name!r} must be one of {', '.join(factor_of)}, got {unit!r}. "
                f"Set {option.replace('column', 'unit')}"
            )
        factors[signal] = factor_of[unit]
    recording = load_recording(path, **reader, auxiliary=auxiliary)
    scaled = {signal: factor * getattr(recording, signal) for signal, factor in factors.items()}
    if position_columns is not None:
        from texclass.haptics.textures.abdulali2016.model_points import speed_of

        xy = tuple(
            _check_column(path, name, "--position-columns", names)
            for name in resolve_columns(split_columns(position_columns), names)
        )
        if shared := ", ".join(set(xy) & set(recording.channels)):
            raise ValueError(f"{path}: {shared} cannot be both position and acceleration. Set --column")
        position = load_recording(path, **reader | {"column": xy, "unit": "arbitrary"}).acceleration
        position = position.reshape(len(position), -1)
        scaled["speed"] = speed_of(position, recording.fs, path.stem)
    return recording.with_(**scaled)


def _check_column(path: Path, name: str, option: str, names: tuple[str, ...]) -> str:
    """Return the name of a column, or raise an error with the closest name."""
    if name in names:
        return name
    without_unit = {re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", column): column for column in names}
    closest = get_close_matches(name, without_unit, n=1, cutoff=0.0)
    listed, hint = ", ".join(names), f". Try {option} {closest[0]}" if closest else ""
    raise ValueError(f"{path} has no column {name!r}. Expected one of {listed:.300}{hint}")
