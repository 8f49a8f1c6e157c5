"""texclass stream, a model and a live source in, surfaces out as they are felt; explore, its rehearsal."""

import json
import os
import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from texclass import shipped
from texclass.cli import options
from texclass.cli.app import command
from texclass.cli.options import progress_bar

NO_ANSWER = 3
"""Exit code of a stream in which nothing was felt long enough for an answer."""


@options.shared("opening")
def opens_source(
    *,
    fs: float | None = None,
    unit: str | None = None,
    resample: bool = False,
    column: options.Column = None,
    delimiter: options.Delimiter = None,
    time_column: options.TimeColumn = None,
    time_unit: options.TimeUnit = None,
    skip_rows: options.SkipRows = None,
    comment: options.Comment = None,
    drop_incomplete: options.DropIncomplete = False,
    channels: int | None = None,
    paced: bool = False,
    reliability: str | None = None,
    depth: int | None = None,
) -> dict[str, Any]:
    """Give a command how a source is opened.

    Parameters
    ----------
    fs
        Sampling rate of the source in Hz, where it does not state it.
    unit
        Of the source; that of the training files by default.
    resample
        Convert another rate to the model's, band-limited.
    channels
        Standard input is little-endian float32 of so many channels, not text.
    paced
        Play a file at its own speed.
    reliability
        Of ros2:/TOPIC: reliable or 'best effort'; what its publishers offer by default.
    depth
        Of ros2:/TOPIC: messages kept until they are taken; 20,000 by default.
    """
    read = options.columns_read(column, delimiter)
    read |= {"time_column": time_column, "time_unit": time_unit, "skip_rows": skip_rows, "comment": comment}
    read["drop_incomplete"] = drop_incomplete or None
    of_topic = {"reliability": reliability, "depth": depth}
    stated = {"fs": fs, "unit": unit, "resample": resample, "paced": paced, "raw_channels": channels}
    return {**stated, **read, **of_topic}


@options.shared("settings")
def listens(
    *,
    touch: float | None = None,
    hop: float | None = None,
    evidence: str = "sequential",
    confidence: float = 0.95,
    stop_when_sure: bool = False,
    forget: float | None = None,
    in_contact: bool | None = None,
    always_in_contact: bool = False,
) -> Any:
    """Give a command how a stream is listened to.

    Parameters
    ----------
    touch
        Seconds of movement of one answer; as trained by default.
    hop
        Seconds from answer to answer; half a touch by default.
    evidence
        How answers of one contact are put together: sequential or majority.
    confidence
        Probability from which on a verdict is sure.
    stop_when_sure
        Compute no more of a contact whose verdict is sure.
    forget
        Seconds after which evidence fades, for tools that slide on to other surfaces; 4 windows with
        --always-in-contact, else never.
    in_contact : --in-contact/--at-rest
        The stream begins in a movement, or at rest; found out by default.
    always_in_contact
        Wheels and legs: no lift-off, and evidence fades (see --forget).
    """
    from texclass.recognition import OnlineSettings

    kind: Any = evidence
    return OnlineSettings(
        window_s=touch,
        hop_s=hop,
        evidence=kind,
        confidence=confidence,
        forget_s=forget or float("inf"),
        stop_when_sure=stop_when_sure,
        assume_contact=in_contact,
        always_in_contact=always_in_contact,
    )


@command("texclass stream surfaces.skops felt.txt --fs 10000 --unit m/s^2")
@listens
@opens_source
def stream(
    model: Path,
    source: Annotated[str, typer.Argument()] = "-",
    as_lines: bool = False,
    json_file: options.Json = None,
    heartbeat: float = 5.0,
    seconds: options.Seconds = None,
    publish: str | None = None,
    diagnostics: str | None = None,
    domain: int | None = None,
    *,
    opening: dict[str, Any],
    settings: Any,
) -> None:
    """Say which surface is felt while it is felt. Ctrl-C, SIGTERM or SIGHUP ends it with the final answer.

    Parameters
    ----------
    model
        A model file that `texclass train` wrote; or a folder of them, one for each gesture (tap.skops,
        slow_stroke.skops): the stream then says which gesture would tell most.
    source
        - (standard input: text, a sample a line), FILE or DATASET:RECORDING, bag:FILE?topic=/NAME,
        ros2:/TOPIC. Columns: axes of the acceleration, then, where the model needs them, 3 of the turn
        rate (rad/s), 1 of the friction.
    as_lines : --jsonl
        Print one JSON object a line: answers, events, notices, the final answer.
    heartbeat
        With --jsonl, a line says every so many seconds that it listens; 0: never.
    publish
        Publish answers as JSON (std_msgs/String) on this ROS 2 topic.
    diagnostics
        With --publish: diagnostic_msgs/DiagnosticArray on this topic, too.
    domain
        DDS domain; $ROS_DOMAIN_ID or 0 by default.
    """
    from texclass.cli.stream_view import view_of
    from texclass.recognition import AskingSession, Session, is_live, load_gestures, load_model, open_source

    if publish:
        answer_publisher = shipped.module_of("sources", "ros2").AnswerPublisher
    models = load_gestures(model) if model.is_dir() else {}
    trained = next(iter(models.values())) if models else load_model(model)
    rate = trained.manifest.fs if opening.pop("resample") else None
    if source.startswith("ros2:") or not publish:  # else the domain is that of the answers alone
        opening["domain"] = domain
    blocks = open_source(source, rate=rate, model=trained, **opening)
    publisher = answer_publisher(publish, diagnostics, domain=domain) if publish else None
    listening: dict[str, Any] = {"raw": is_live(source), "settings": settings}
    session = (
        AskingSession(models, seconds=options.seconds_of(seconds), **listening)
        if models
        else Session(trained, **listening)
    )
    shown = view_of(session, source, as_lines, heartbeat)
    shown.contacts = None if json_file is None else {}
    answered = _heard(shown, session, blocks, publisher)
    if shown.contacts is not None:
        found = {"source": source, "contacts": [*shown.contacts.values()]}
        options.write_json(json_file, json.dumps(found, indent=1))
    if not answered:
        raise typer.Exit(NO_ANSWER)


def _heard(shown: Any, session: Any, blocks: Any, publisher: Any) -> bool:
    """Tell what a session makes of blocks, till they end or somebody ends it; return whether it answered."""
    from texclass.cli.stream_view import tell

    ending = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # nohup ignores SIGHUP, and that stays so
    heeded = [number for number in ending if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, signal.default_int_handler) for number in heeded}
    try:
        with shown:
            try:
                shown.listening()
                for block in blocks:
                    tell(shown, session.take(block), publisher)
            except KeyboardInterrupt:
                pass
            finally:
                blocks.close()
            tell(shown, session.finish(), publisher)
        return bool(shown.end())
    except BrokenPipeError:  # nobody reads any more, and nobody asks for more than was found till then
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return True
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if publisher is not None:
            publisher.close()


@command("texclass explore --surface wood-03 -o gestures")
def explore(
    models: Annotated[Path | None, typer.Argument()] = None,
    surface: list[str] | None = None,
    confidence: float = 0.95,
    seconds: options.Seconds = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    output: Annotated[Path | None, options.WRITES_FOLDER] = None,
    as_lines: options.JsonLines = False,
) -> None:
    """Show how to explore: a simulated hand makes the gesture that would tell most, until it is sure.

    Parameters
    ----------
    models
        Folder of models that `-o` wrote; by default they are trained on simulated gestures.
    surface
        What is explored, several times; each of the six by default.
    confidence
        Probability from which on a surface is sure.
    seed
        Of what the simulated hand does.
    output : -o, --output
        Folder to write the models to; `texclass stream` takes it.
    """
    from texclass.recognition import load_gestures
    from texclass.recognition.exploration import REHEARSED, rehearse, train_gestures

    if models is not None:
        trained = load_gestures(models)
    else:
        with progress_bar() as progress:
            trained = train_gestures(progress=progress)
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        for name, model in trained.items():
            model.save(output / f"{name.replace(' ', '_')}.skops")
    for name in surface or [one.name for one in REHEARSED.surfaces]:
        costs = options.seconds_of(seconds)
        for step in rehearse(trained, name, seed=seed, seconds=costs, confidence=confidence):
            advice = step["advice"]
            if as_lines:
                facts = {key: step[key] for key in ("gesture", "seconds", "surface", "probability", "sure")}
                facts |= {key: round(step[key], 6) for key in ("seconds", "probability")}
                following = None if advice is None else advice.gesture
                typer.echo(json.dumps({"felt": name, **facts, "next": following}))
            else:
                told = f"{step['surface']}, {100 * step['probability']:.1f} %{', sure' * step['sure']}"
                after = f"; next: {advice}" if advice is not None else ""
                typer.echo(f"{name}: {step['seconds']:5.2f} s  {step['gesture']:<12} {told}{after}")
