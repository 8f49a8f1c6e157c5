"""texclass stream: a model and a live source in, surfaces out as they are felt."""

import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from texclass.cli import options
from texclass.cli.app import app

NO_ANSWER = 3
"""Exit code of a stream in which nothing was felt long enough for an answer."""


@app.command()
def stream(
    model: Annotated[Path, typer.Argument(help="A model file that `texclass train` wrote.")],
    source: Annotated[
        str,
        typer.Option(
            help="- (standard input: text, a sample a line), FILE or DATASET:RECORDING, "
            "bag:FILE?topic=/NAME, ros2:/TOPIC. Columns: axes of the acceleration, then, where the model "
            "needs them, 3 of the turn rate (rad/s), 1 of the friction."
        ),
    ] = "-",
    rate: Annotated[
        float | None,
        typer.Option("--rate", "--fs", help="Sampling rate of the source in Hz, where it does not state it."),
    ] = None,
    unit: Annotated[
        str | None, typer.Option("--unit", help="Of the source; that of the training files by default.")
    ] = None,
    resample: Annotated[
        bool, typer.Option("--resample", help="Convert another rate to the model's, band-limited.")
    ] = False,
    column: options.Column = None,
    delimiter: options.Delimiter = None,
    time_column: options.TimeColumn = None,
    window: Annotated[
        float | None, typer.Option(help="Seconds of one answer; as trained by default.")
    ] = None,
    hop: Annotated[
        float | None, typer.Option(help="Seconds from answer to answer; half a window by default.")
    ] = None,
    evidence: Annotated[
        str, typer.Option(help="How answers of one contact are put together: sequential or majority.")
    ] = "sequential",
    confidence: Annotated[float, typer.Option(help="Probability from which on a verdict is sure.")] = 0.95,
    stop_when_sure: Annotated[
        bool, typer.Option("--stop-when-sure", help="Compute no more of a contact whose verdict is sure.")
    ] = False,
    forget: Annotated[
        float | None,
        typer.Option(help="Seconds after which evidence fades, for tools that slide on to other surfaces."),
    ] = None,
    in_contact: Annotated[
        bool | None,
        typer.Option(
            "--in-contact/--at-rest",
            help="The stream begins in a movement, or at rest; found out by default.",
        ),
    ] = None,
    channels: Annotated[
        int | None,
        typer.Option(help="Standard input is little-endian float32 of so many channels, not text."),
    ] = None,
    paced: Annotated[bool, typer.Option("--paced", help="Play a file at its own speed.")] = False,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="One JSON object a line: answers, events, notices, the final answer."),
    ] = False,
) -> None:
    """Say which surface is felt while it is felt; Ctrl-C ends it."""
    from texclass.cli.stream_view import view_of
    from texclass.recognition import OnlineSettings, Session, is_live, load_model, open_source

    kind: Any = evidence
    settings = OnlineSettings(
        window_s=window,
        hop_s=hop,
        evidence=kind,
        confidence=confidence,
        forget_s=forget or float("inf"),
        stop_when_sure=stop_when_sure,
        assume_contact=in_contact,
    )
    trained = load_model(model)
    blocks = open_source(
        source,
        fs=rate,
        unit=unit,
        rate=trained.manifest.fs if resample else None,
        paced=paced,
        raw_channels=channels,
        **options.columns_read(column=column, delimiter=delimiter, time_column=time_column),
        model=trained,
    )
    session = Session(trained, raw=is_live(source), settings=settings)
    try:
        with view_of(session, source, as_json) as shown:
            try:
                for block in blocks:
                    shown.show(session.take(block))
            except KeyboardInterrupt:
                pass
            finally:
                blocks.close()
            shown.show(session.finish())
        answered = shown.end()
    except BrokenPipeError:  # nobody reads any more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    else:
        if not answered:
            raise typer.Exit(NO_ANSWER)
