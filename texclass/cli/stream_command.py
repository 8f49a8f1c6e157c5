"""Commands on live streams: stream (classify) and explore (rehearse active exploration in simulation)."""

import json
import os
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer import Argument, Option

from texclass import shipped
from texclass.cli import parameters as p
from texclass.cli.app import app
from texclass.cli.output import progress_bar, write_json

contact_option = partial(Option, rich_help_panel="Contact")


@app.command(
    rich_help_panel="Models", epilog="Example: texclass stream surfaces.skops new.txt --fs 10000 --unit m/s^2"
)
@p.with_reader_options
def stream(
    model: Annotated[
        Path,
        Argument(
            help="Model file written by `texclass train`, or a folder with one model per gesture (tap.skops, "
            "slow_stroke.skops): the stream then also recommends the next gesture."
        ),
    ],
    source: Annotated[
        str,
        Argument(
            help="- (standard input, one sample per line), FILE, DATASET:RECORDING, bag:FILE?topic=/NAME or "
            "ros2:/TOPIC. Columns: acceleration, followed by turn rate (3 columns, rad/s) and friction (1 "
            "column) if the model uses them."
        ),
    ] = "-",
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
    stop_when_sure: Annotated[
        bool,
        Option("--stop-when-sure", help="Skip the remaining windows of a contact once its answer is sure."),
    ] = False,
    gesture_time: p.GestureTime = None,
    adapt: Annotated[
        bool,
        Option(
            "--adapt",
            help="Adapt the model to the last 60 contacts, without labels, as the sensor drifts. Requires 10 "
            "contacts with several surfaces.",
        ),
    ] = False,
    forget: Annotated[
        float | None,
        contact_option(
            metavar="S",
            help="Time constant with which evidence decays, for tools that slide from one surface to another "
            "(default: no decay; 4 windows with --always-in-contact).",
        ),
    ] = None,
    in_contact: Annotated[
        bool | None,
        contact_option(
            "--in-contact/--at-rest", help="State at the start of the stream (default: detected)."
        ),
    ] = None,
    always_in_contact: Annotated[
        bool,
        contact_option(
            "--always-in-contact", help="For wheels and legs: detect no lift-off, and let evidence decay."
        ),
    ] = False,
    *,
    unit: Annotated[
        str | None, p.data_option(metavar="UNIT", help="Unit of the acceleration (default: as in training).")
    ] = None,
    reader: p.Reader,
    resample: p.Resample = None,
    channels: Annotated[
        int | None,
        p.data_option(
            metavar="N",
            help="Read standard input as little-endian float32 with N channels, instead of as text.",
        ),
    ] = None,
    real_time: Annotated[
        bool, p.data_option("--real-time", help="Read a file at the speed at which it was recorded.")
    ] = False,
    reliability: Annotated[
        str | None,
        p.data_option(
            metavar="NAME",
            help="Reliability of a ROS 2 subscription: reliable or 'best effort' (default: as published).",
        ),
    ] = None,
    depth: Annotated[
        int | None,
        p.data_option(
            metavar="N", help="Queue length of a ROS 2 subscription in messages (default: 20,000)."
        ),
    ] = None,
    as_lines: p.JsonLines = False,
    heartbeat: Annotated[
        float,
        p.output_option(metavar="S", help="With --jsonl: time between two heartbeat lines; 0 disables them."),
    ] = 5.0,
    json_file: p.JsonFile = None,
    publish: Annotated[
        str | None,
        p.output_option(
            metavar="TOPIC", help="Publish answers as JSON (std_msgs/String) on this ROS 2 topic."
        ),
    ] = None,
    typed: Annotated[
        bool,
        p.output_option(
            "--typed",
            help="Publish answers as texclass_msgs/SurfaceAnswer instead of JSON, and events as "
            "texclass_msgs/ContactEvent on TOPIC/contact.",
        ),
    ] = False,
    diagnostics: Annotated[
        str | None,
        p.output_option(metavar="TOPIC", help="Also publish diagnostic_msgs/DiagnosticArray on this topic."),
    ] = None,
    domain: Annotated[
        int | None, p.output_option(metavar="N", help="DDS domain (default: $ROS_DOMAIN_ID, or 0).")
    ] = None,
) -> None:
    """Classify a live stream while the tool is in contact with a surface.

    Ctrl-C, SIGTERM and SIGHUP end the stream with a final answer.
    """
    if (diagnostics or typed) and not publish:
        raise typer.BadParameter(f"{'--diagnostics' if diagnostics else '--typed'} requires --publish")
    seconds = p.numbers_by_name("--gesture-time", gesture_time)
    from texclass.cli.stream_view import view_of
    from texclass.recognition import (
        ExplorationSession,
        OnlineSettings,
        Session,
        is_live,
        load_gestures,
        load_model,
        open_source,
    )

    settings = OnlineSettings(
        window_s=window,
        hop_s=hop,
        evidence=evidence,
        confidence=confidence,
        forget_s=float("inf") if forget is None else forget,
        stop_when_sure=stop_when_sure,
        starts_in_contact=in_contact,
        always_in_contact=always_in_contact,
    )
    if publish:
        publishers = shipped.module_of("sources", "ros2")
        publisher_class = publishers.SurfacePublisher if typed else publishers.AnswerPublisher
    models = load_gestures(model) if model.is_dir() else {}
    if adapt and models:
        raise typer.BadParameter("--adapt requires a model file, got a folder of models")
    trained = next(iter(models.values())) if models else load_model(model)
    topic: dict[str, Any] = {"reliability": reliability, "depth": depth}
    if source.startswith("ros2:") or not publish:  # otherwise --domain applies only to the published answers
        topic["domain"] = domain
    blocks = open_source(
        source,
        unit=unit,
        rate=resample,
        model=trained,
        paced=real_time,
        raw_channels=channels,
        **reader,
        **topic,
    )
    publisher = publisher_class(publish, diagnostics, domain=domain) if publish else None
    session = (
        ExplorationSession(models, seconds=seconds, raw=is_live(source), settings=settings)
        if models
        else Session(trained, raw=is_live(source), settings=settings, adapt=adapt)
    )
    view = view_of(session, source, as_lines, heartbeat)
    view.contacts = None if json_file is None else {}
    has_answer = _run(view, session, blocks, publisher, is_typed=typed)
    if view.contacts is not None:
        contacts = {"source": source, "contacts": [*view.contacts.values()]}
        write_json(json_file, json.dumps(contacts, indent=1))
    if not has_answer:
        raise typer.Exit(3)  # documented in the help of `texclass`


def _run(view: Any, session: Any, blocks: Any, publisher: Any, *, is_typed: bool) -> bool:
    """Show the answers until the stream ends or is interrupted; return whether there was an answer."""
    from texclass.cli.stream_view import show_and_publish

    publishers = (None, publisher) if is_typed else (publisher, None)
    ending = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # under nohup, SIGHUP is ignored, and must stay ignored
    handled = [number for number in ending if signal.getsignal(number) != signal.SIG_IGN]
    old_handlers = {number: signal.signal(number, signal.default_int_handler) for number in handled}
    try:
        with view:
            try:
                view.on_open()
                for block in blocks:
                    show_and_publish(view, session.push(block), *publishers)
            except KeyboardInterrupt:
                pass
            finally:
                blocks.close()
            show_and_publish(view, session.finish(), *publishers)
        return bool(view.end())
    except BrokenPipeError:  # the reader has closed the pipe: the answers so far are the result
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return True
    finally:
        for number, handler in old_handlers.items():
            signal.signal(number, handler)
        if publisher is not None:
            publisher.close()


@app.command(rich_help_panel="Models", epilog="Example: texclass explore --surface wood-03 -o gestures")
def explore(
    models: Annotated[
        Path | None,
        Argument(
            help="Folder of models written by `texclass explore -o` (default: train on simulated gestures)."
        ),
    ] = None,
    surface: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Simulated surface to explore (repeatable; default: all six)."),
    ] = None,
    confidence: p.Confidence = 0.95,
    gesture_time: p.GestureTime = None,
    seed: p.Seed = 0,
    output: Annotated[
        Path | None,
        p.output_folder("--output", "-o", help="Folder for the models, for use with `texclass stream`."),
    ] = None,
    as_lines: p.JsonLines = False,
) -> None:
    """Rehearse active exploration with a simulated hand.

    Each step makes the gesture with the highest expected information gain per second, until the answer is
    sure.
    """
    seconds = p.numbers_by_name("--gesture-time", gesture_time)
    from texclass.recognition import load_gestures
    from texclass.recognition.exploration import REHEARSAL_RECIPE, rehearse, train_gestures

    if models is not None:
        trained = load_gestures(models)
    else:
        with progress_bar() as progress:
            trained = train_gestures(progress=progress)
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        for name, model in trained.items():
            model.save(output / f"{name.replace(' ', '_')}.skops")
    for name in surface or [item.name for item in REHEARSAL_RECIPE.surfaces]:
        for step in rehearse(trained, name, seed=seed, seconds=seconds, confidence=confidence):
            if as_lines:
                typer.echo(json.dumps({"true_surface": name, **_step_facts(step)}))
            else:
                is_sure = ", sure" if step["sure"] else ""
                advice = "" if step["advice"] is None else f"; next: {step['advice']}"
                typer.echo(
                    f"{name}: {step['seconds']:5.2f} s  {step['gesture']:<12} {step['surface']}, "
                    f"{100 * step['probability']:.1f} %{is_sure}{advice}"
                )


def _step_facts(step: dict[str, Any]) -> dict[str, Any]:
    """Return the facts of one step of a rehearsal, for JSON."""
    return {
        "gesture": step["gesture"],
        "seconds": round(step["seconds"], 6),
        "surface": step["surface"],
        "probability": round(step["probability"], 6),
        "sure": step["sure"],
        "next": None if step["advice"] is None else step["advice"].gesture,
    }
