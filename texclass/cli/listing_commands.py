"""What there is, to look at: recordings, datasets, a sample, features."""

import io
from pathlib import Path
from typing import Annotated, Any

import typer

from texclass.cli import options
from texclass.cli.app import app, command
from texclass.cli.options import progress_bar, shipped, tell

PICTURE_FORMATS = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
cards = typer.Typer(invoke_without_command=True, epilog="Example: texclass datasets get taps5")
app.add_typer(cards, name="datasets")


@command("texclass inspect recordings/oak/oak_01.txt --fs 10000 --unit m/s^2")
@options.reads_files
def inspect(
    recording: str,
    output: Annotated[Path | None, options.writes(*PICTURE_FORMATS)] = None,
    features: Annotated[str, typer.Option(autocompletion=shipped("feature_defs"))] = "strese2015",
    *,
    reading: dict[str, Any],
) -> None:
    """Draw one recording: phases, taps, spectrum and features.

    Parameters
    ----------
    recording
        A file in any supported format, or DATASET:RECORDING (simulated:wood-03-01).
    output : -o, --output
        Picture to write (.png, .pdf, .svg, .jpg, .tif or .webp); <recording>.inspect.png here by default.
    features
        Feature set whose values are shown.
    """
    from texclass.loaders import find_recording

    found = find_recording(recording, **reading)
    from texclass.atomic_write import write_atomic
    from texclass.evaluation.inspection import inspected
    from texclass.reporting.wording import counted

    figure, phases = inspected(found, features)
    path = output or Path(f"{Path(found.recording_id).name}.inspect.png")
    picture = io.BytesIO()
    figure.savefig(picture, dpi=130, format=path.suffix[1:].lower())
    write_atomic(path, picture.getvalue())
    moved = "none"
    if phases.movement is not None:
        moved = "{:.2f} to {:.2f} s".format(*(sample / found.fs for sample in phases.movement))
    typer.echo(f"{phases.kind}: {counted(len(phases.taps), 'tap')}, movement {moved}")
    for note in (*found.flags, *phases.notes):
        typer.echo(f"note: {note}")
    typer.echo(f"wrote {path}")


@command("texclass card recordings --fs 10000 --unit m/s^2 -o recordings.toml")
@options.reads_files
def card(
    folder: Path,
    output: Annotated[Path, options.writes(".toml")] = Path("card.toml"),
    labels: options.Labels = None,
    *,
    reading: dict[str, Any],
) -> None:
    """Write a dataset card for a folder. What the folder leaves open is a question in a comment.

    Parameters
    ----------
    folder
        Folder of recordings: one subfolder per surface, or files named by surface and number.
    output : -o, --output
        Card to write (.toml); card.toml here by default.
    """
    from texclass.atomic_write import write_atomic
    from texclass.loaders import draft_card
    from texclass.loaders.card_draft import QUESTION

    if output.exists():
        raise FileExistsError(f"{output} exists already. Remove it, or choose another file with --output")
    text = draft_card(folder, output.parent, labels=labels, **reading)
    write_atomic(output, text)
    for line in text.splitlines():
        if line.startswith(QUESTION):
            typer.echo(f"question: {line.removeprefix(QUESTION)}")
    typer.echo(f"wrote {output}. Check it, then: texclass benchmark {output}")


@command("texclass sample recordings")
def sample(
    folder: Path,
    first: Annotated[int, typer.Option(min=1, max=995)] = 1,
) -> None:
    """Write a small folder of recordings to try commands on.

    Parameters
    ----------
    folder
        Folder to write, one subfolder per surface.
    first
        Number of the first recording of each surface.
    """
    from texclass.loaders import write_sample

    written = write_sample(folder, first)
    typer.echo(f"wrote {len(written)} recordings, in m/s^2 at 10000 Hz. Look at one:")
    typer.echo(f"texclass inspect {written[0]} --fs 10000 --unit m/s^2")


@cards.callback()
def datasets(context: typer.Context) -> None:
    """List the dataset cards; `get` fetches published recordings."""
    if context.invoked_subcommand is None:
        from texclass.cli.listings import datasets_document

        tell(datasets_document())


@command("texclass datasets get taps5", cards)
def get(
    names: Annotated[list[str], typer.Argument(autocompletion=shipped("datasets"))],
) -> None:
    """Fetch the recordings of cards from where they are published.

    Parameters
    ----------
    names
        Shipped dataset cards, or cards of yours (TOML).
    """
    from texclass.loaders import fetch_recordings, read_card

    for name in names:
        card = read_card(name)
        typer.echo(f"{card.title}\nfrom: {card.source}\nlicence: {card.licence}")
        if card.citation:
            typer.echo(f"cite: {card.citation}")
        with progress_bar() as progress:
            folder = fetch_recordings(name, progress)
        typer.echo(f"complete, each file as published: {folder}")


@command("texclass features strese2015")
def features(
    name: Annotated[str | None, typer.Argument(autocompletion=shipped("feature_defs"))] = None,
) -> None:
    """List every feature with its source, or those of one set.

    Parameters
    ----------
    name
        A shipped feature set or a TOML of yours.
    """
    from texclass.cli.listings import features_document

    tell(features_document(name))
