"""Commands on recordings and datasets: sample, card, inspect, datasets."""

import io
import shlex
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from texclass.cli import parameters as p
from texclass.cli.app import app
from texclass.cli.output import print_lines, progress_bar

cards = typer.Typer(invoke_without_command=True, epilog="Example: texclass datasets show taps5")


@app.command(rich_help_panel="Recordings", epilog="Example: texclass sample recordings")
def sample(
    folder: Annotated[Path, Argument(help="Folder to write, with one subfolder per surface.")],
    first: Annotated[
        int, Option(min=1, max=995, metavar="N", help="Number of the first recording of each surface.")
    ] = 1,
) -> None:
    """Write a small folder of simulated recordings, to try the commands."""
    from texclass.loaders import write_sample

    files = write_sample(folder, first)
    typer.echo(f"wrote {len(files)} recordings, in m/s^2 at 10000 Hz. To inspect one:")
    typer.echo(f"texclass inspect {files[0]} --fs 10000 --unit m/s^2")


@app.command(
    rich_help_panel="Recordings",
    epilog="Example: texclass card recordings --fs 10000 --unit m/s^2 -o recordings.toml",
)
@p.with_reader_options
def card(
    folder: Annotated[
        Path,
        Argument(
            help="Folder of recordings: one subfolder per surface, or files named by surface and number."
        ),
    ],
    *,
    reader: p.Reader,
    labels: p.Labels = None,
    output: Annotated[
        Path, p.output_file("--output", "-o", suffixes=[".toml"], help="Dataset card to write (.toml).")
    ] = Path("card.toml"),
) -> None:
    """Draft a dataset card for a folder; comments ask for facts that the files do not state."""
    from texclass.atomic_write import write_atomic
    from texclass.loaders import draft_card
    from texclass.loaders.card_draft import QUESTION

    if output.exists():
        raise FileExistsError(f"{output} already exists. Remove it, or choose another file with --output")
    text = draft_card(folder, output.parent, labels=labels, **reader)
    write_atomic(output, text)
    lines = text.splitlines()
    print_lines("question:", (line.removeprefix(QUESTION) for line in lines if line.startswith(QUESTION)))
    typer.echo(f"wrote {output}. Check it, then run: texclass benchmark {output}")


@app.command(
    rich_help_panel="Recordings",
    epilog="Example: texclass inspect recordings/oak/oak_01.txt --fs 10000 --unit m/s^2",
)
@p.with_reader_options
def inspect(
    context: typer.Context,
    recording: Annotated[
        str, Argument(help="File in any supported format, or DATASET:RECORDING, e.g. simulated:wood-03-01.")
    ],
    features: p.FeatureSet = "strese2015",
    *,
    reader: p.Reader,
    tap_spacing: p.TapSpacing = None,
    output: Annotated[
        Path | None,
        p.output_file(
            "--output",
            "-o",
            suffixes=[".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".html"],
            help="Figure to write: .png, .pdf, .svg, .jpg, .tif or .webp (default: RECORDING.inspect.png). "
            "With --edit: page to write (.html).",
        ),
    ] = None,
    edit: Annotated[
        bool,
        p.output_option(
            "--edit", help="Write a page on which taps, movement and surfaces are corrected and saved."
        ),
    ] = False,
    phases: Annotated[
        Path | None,
        p.data_option(
            "--phases",
            metavar="FILE",
            help="File saved by the page of --edit: check it, and copy it next to the recording.",
        ),
    ] = None,
) -> None:
    """Plot one recording: phases, taps, spectrum and features. With --edit, correct its phases."""
    from texclass.loaders import find_recording
    from texclass.loaders.phases_files import split_part

    if edit and output is None:
        raise typer.BadParameter("--edit requires --output, the page to write, for example -o phases.html")
    if output is not None and (output.suffix.lower() == ".html") != edit:
        expected = "Expected .html with --edit" if edit else "Pass --edit to write a page (.html)"
        raise typer.BadParameter(f"cannot write {output}: the suffix is {output.suffix!r}. {expected}")
    if edit or phases is not None:
        recording, _ = split_part(recording)
    one = find_recording(recording, **reader)
    if phases is not None:
        from texclass.evaluation.phases_page import copy_phases

        typer.echo(f"wrote {copy_phases(phases, one)}")
        one = find_recording(recording, **reader)
    if tap_spacing is not None:
        one = one.with_(phase_settings=replace(one.phase_settings, tap_spacing_s=tap_spacing))
    from texclass.atomic_write import write_atomic

    if edit and output is not None:
        from texclass.evaluation.phases_page import phases_page

        write_atomic(output, phases_page(one, command=_repeat(context, {"edit", "output", "phases"})))
        typer.echo(f"wrote {output}. Open it in a browser, correct the phases, and save them")
        return
    from texclass.evaluation.inspection import inspect_recording
    from texclass.reporting.wording import counted

    figure, found = inspect_recording(one, features)
    path = output or Path(f"{Path(one.recording_id).name}.inspect.png")
    image = io.BytesIO()
    figure.savefig(image, dpi=130, format=path.suffix[1:].lower())
    write_atomic(path, image.getvalue())
    movement = "none"
    if found.movement is not None:
        start, stop = found.movement
        movement = f"{start / one.fs:.2f} to {stop / one.fs:.2f} s"
    typer.echo(f"{found.kind}: {counted(len(found.taps), 'tap')}, movement {movement}")
    print_lines("note:", (*one.flags, *found.notes))
    typer.echo(f"wrote {path}")


def _repeat(context: typer.Context, left_out: Collection[str]) -> str:
    """Return the command line of a context without the given options."""
    words = context.command_path.split()
    for parameter in context.command.params:
        name = str(parameter.name)
        value, source = context.params.get(name), context.get_parameter_source(name)
        if name in left_out or source is None or source.name != "COMMANDLINE":
            continue
        flag = [] if parameter.param_type_name == "argument" else [parameter.opts[-1]]
        text = str(value).removesuffix(".0") if isinstance(value, float) else str(value)
        words += [*flag, *([] if value is True else [text])]
    return shlex.join(words)


@cards.callback()
def datasets(context: typer.Context) -> None:
    """List the shipped dataset cards, show one of them, or download its published recordings."""
    if context.invoked_subcommand is None:
        from texclass.cli.listings import datasets_document
        from texclass.reporting import print_document

        print_document(datasets_document())


@cards.command(epilog="Example: texclass datasets show fabric_speeds")
def show(
    name: Annotated[
        str,
        Argument(
            help="Shipped dataset card, or card file (TOML).", autocompletion=p.shipped_names("datasets")
        ),
    ],
) -> None:
    """Show the labels of a dataset, and the evaluation protocols that its card declares."""
    from texclass.cli.listings import dataset_document
    from texclass.reporting import print_document

    print_document(dataset_document(name))


@cards.command(epilog="Example: texclass datasets get taps5")
def get(
    names: Annotated[
        list[str],
        Argument(
            help="Shipped dataset cards, or card files (TOML).", autocompletion=p.shipped_names("datasets")
        ),
    ],
) -> None:
    """Download the published recordings that dataset cards describe."""
    from texclass.loaders import fetch_recordings, read_card

    for name in names:
        card = read_card(name)
        typer.echo(f"{card.title}\nfrom: {card.source}\nlicence: {card.licence}")
        if card.citation:
            typer.echo(f"cite: {card.citation}")
        with progress_bar() as progress:
            folder = fetch_recordings(name, progress)
        typer.echo(f"complete, checksums verified: {folder}")


app.add_typer(cards, name="datasets", rich_help_panel="Recordings")
