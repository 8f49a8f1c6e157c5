"""Command score-stream: evaluate the recognition in a stream on recordings whose contacts are known."""

from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from texclass.cli import parameters as p
from texclass.cli.app import app, escape_control_characters
from texclass.cli.output import RECORDING_KERNELS, announce_start, print_lines, progress_bar, write_json
from texclass.cli.stream_command import contact_option


@app.command(
    rich_help_panel="Models",
    epilog="Example: texclass score-stream surfaces.skops drives --intervals intervals.csv -o score",
)
@p.with_reader_options
def score_stream(
    model: p.ModelFile,
    recordings: Annotated[
        list[str],
        Argument(help="Recordings: files, bags, DATASET:RECORDING, dataset cards or folders."),
    ],
    *,
    intervals: Annotated[
        Path,
        Option(
            metavar="CSV",
            help="Contacts: columns start_s and end_s (seconds since the first sample), surface, and "
            "recording for several recordings. A row with a recording only declares that it has no contact.",
        ),
    ],
    window: Annotated[
        float | None, Option(metavar="S", help="Length of the windows (default: as in training).")
    ] = None,
    hop: Annotated[
        float | None, Option(metavar="S", help="Time between two answers (default: half a window).")
    ] = None,
    evidence: Annotated[
        Literal["sequential", "majority"],
        Option(
            metavar="RULE",
            help="Rule that combines the windows of a contact: sequential (Bayes) or majority (vote).",
        ),
    ] = "sequential",
    confidence: p.Confidence = 0.95,
    adapt: Annotated[
        bool,
        Option("--adapt", help="Adapt the model to the last 60 contacts of each recording, without labels."),
    ] = False,
    forget: Annotated[
        float | None,
        contact_option(metavar="S", help="Time constant with which evidence decays (default: no decay)."),
    ] = None,
    in_contact: Annotated[
        bool | None,
        contact_option(
            "--in-contact/--at-rest", help="State at the start of each recording (default: detected)."
        ),
    ] = None,
    always_in_contact: Annotated[
        bool,
        contact_option(
            "--always-in-contact", help="For wheels and legs: detect no lift-off, and let evidence decay."
        ),
    ] = False,
    reader: p.Reader,
    skip_bad: Annotated[
        bool,
        p.data_option(
            "--skip-bad", help="Exit with code 0 even if recordings are unreadable or have no intervals."
        ),
    ] = False,
    output: Annotated[
        Path | None,
        p.output_folder(
            "--output", "-o", help="Folder for the report (Markdown), figures (PNG), JSON and CSV."
        ),
    ] = None,
    json_file: p.JsonFile = None,
) -> None:
    """Score `stream` on recordings with known contacts: false alarms, missed contacts, delays, confusion.

    The recordings are played like a live stream, but as fast as possible. Bad recordings are listed and left
    out.
    """
    announce_start(*RECORDING_KERNELS)
    from texclass.recognition import OnlineSettings
    from texclass.recognition.live import stream_score
    from texclass.reporting import print_document

    settings = OnlineSettings(
        window_s=window,
        hop_s=hop,
        evidence=evidence,
        confidence=confidence,
        forget_s=float("inf") if forget is None else forget,
        starts_in_contact=in_contact,
        always_in_contact=always_in_contact,
    )
    with progress_bar() as progress:
        result = stream_score.score_stream(
            model,
            recordings,
            intervals,
            settings=settings,
            adapt=adapt,
            skip_bad=True,
            progress=progress,
            **reader,
        )
    left_out = result.data["left_out"]
    for one in left_out:
        typer.echo(f"error: {escape_control_characters(one['problem'])}", err=True)
    print_document(result.document())
    write_json(json_file, result.to_json())
    print_lines("wrote", () if output is None else result.save(output))
    if left_out and not skip_bad:
        raise typer.Exit(1)
