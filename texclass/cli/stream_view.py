"""Views of a stream for `texclass stream`: live display in a terminal, text lines, or JSON lines."""

import json
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Protocol, Self

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from texclass.recognition import ContactVerdict, Event, ExplorationVerdict, Notice, Session, WindowAnswer
from texclass.recognition.prediction_sets import describe_sets
from texclass.reporting.wording import counted


class TextView:
    """Print events, notices and each change of the verdict, one per line.

    Parameters
    ----------
    session : Session
        Session whose answers are shown.
    source : str
        Name of the source.
    """

    def __init__(self, session: Session, source: str) -> None:
        self.session, self.source = session, source
        self.answer: WindowAnswer | None = None
        """The last answer."""
        self.final: tuple[ContactVerdict, float, float] | None = None
        """The last verdict, with start and end of its contact in seconds."""
        self.contacts: dict[int, dict[str, Any]] | None = None
        """The last answer of each contact, by onset. None stores no answers, since a stream may never end."""
        self.n_answers = 0
        self._printed: tuple[object, ...] = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Do nothing; a text view has nothing to close."""

    def on_open(self) -> None:
        """Report on standard error that the source is open."""
        typer.echo(f"listening to {self.source}", err=True)

    def on_answer(self, update: WindowAnswer) -> None:
        """Print the verdict if the contact, the surface, `sure` or `unknown` has changed."""
        verdict = update.verdict
        if (now := (update.onset, verdict.surface, verdict.sure, verdict.unknown)) != self._printed:
            self._printed = now
            typer.echo(f"{self.seconds(update.n_received):9.3f} s  {describe_verdict(verdict)}")

    def on_event(self, event: Event) -> None:
        """Print an event."""
        message = f" ({event.message})" if event.message else ""
        typer.echo(f"{self.seconds(event.sample):9.3f} s  {event.kind}{message}")

    def on_notice(self, notice: Notice) -> None:
        """Print a notice on standard error."""
        typer.echo(f"notice: {notice.message}", err=True)

    def on_end(self, verdict: ContactVerdict, start_s: float, stop_s: float) -> None:
        """Print the final answer."""
        typer.echo(f"final: {describe_verdict(verdict)}, contact from {start_s:.3f} s to {stop_s:.3f} s")

    def show(self, updates: Iterable[Event | WindowAnswer | Notice]) -> None:
        """Show the events, answers and notices of a block."""
        for update in updates:
            if isinstance(update, WindowAnswer):
                self.n_answers += 1
                self.answer = update
                if self.contacts is not None:
                    self.contacts[update.onset] = self.facts(update)
                self.final = update.verdict, self.seconds(update.onset), self.seconds(update.stop)
                self.on_answer(update)
            elif isinstance(update, Event):
                self.on_event(update)
            else:
                self.on_notice(update)

    def end(self) -> bool:
        """Show the final answer if there is one, and return whether there is one."""
        if self.final is None:
            typer.echo("no answer: no contact was as long as one window", err=True)
            return False
        self.on_end(*self.final)
        return True

    def facts(self, update: WindowAnswer) -> dict[str, Any]:
        """Return the JSON values of an answer; `age_s` is the age of the last sample of its window."""
        fs = self.session.recogniser.fs if self.session.recogniser else math.nan
        return {
            "t_s": self.seconds(update.n_received),
            "start_s": self.seconds(update.start),
            "stop_s": self.seconds(update.stop),
            "onset_s": self.seconds(update.onset),
            "age_s": (update.n_received - update.stop) / fs + self.session.age_s,
            **update.verdict.to_dict(),
            "reasons": list(update.answer.reasons),
        }

    def seconds(self, sample: int) -> float:
        """Return the time of a sample in seconds since the start of the stream."""
        recogniser = self.session.recogniser
        return sample / recogniser.fs if recogniser else 0.0


class JsonView(TextView):
    """Print one JSON object per line, with `type` open, answer, event, notice, heartbeat or final.

    Parameters
    ----------
    session, source
        See `TextView`.
    heartbeat_s : float
        Time between two heartbeats in seconds (default 0: no heartbeats).
    """

    def __init__(self, session: Session, source: str, heartbeat_s: float = 0.0) -> None:
        super().__init__(session, source)
        self._heartbeat_s, self._has_ended, self._lock = heartbeat_s, threading.Event(), threading.Lock()

    def __enter__(self) -> Self:
        """Start the heartbeat, which continues while no samples arrive."""
        if self._heartbeat_s > 0:
            threading.Thread(target=self._beat, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop the heartbeat."""
        self._has_ended.set()

    def _beat(self) -> None:
        while not self._has_ended.wait(self._heartbeat_s):
            recogniser, age_s = self.session.recogniser, self.session.age_s
            t_s, phase = (
                (self.seconds(recogniser.n_samples), recogniser.phase) if recogniser else (0.0, "waiting")
            )
            age = age_s if math.isfinite(age_s) else None
            try:
                self._print("heartbeat", t_s=t_s, phase=phase, age_s=age, n_answers=self.n_answers)
            except OSError:  # the reader has closed the pipe: the main thread handles it
                return

    def on_open(self) -> None:
        """Print an object that reports that the source is open."""
        self._print("open", source=self.source)

    def on_answer(self, update: WindowAnswer) -> None:
        """Print an answer: the verdict for its contact, and the answer for its window alone."""
        window = {k: v for k, v in update.answer.to_dict().items() if k not in ("recording", "reasons")}
        compute_ms = round(update.compute_ms, 3)
        self._print("answer", **self.facts(update), window=window, compute_ms=compute_ms)

    def on_event(self, event: Event) -> None:
        """Print an event, with the time at which it occurred and the time at which it was detected."""
        t_s, event_s = self.seconds(event.n_received), self.seconds(event.sample)
        self._print("event", t_s=t_s, kind=event.kind, event_s=event_s, message=event.message)

    def on_notice(self, notice: Notice) -> None:
        """Print a notice."""
        self._print("notice", t_s=notice.t_s, message=notice.message)

    def on_end(self, verdict: ContactVerdict, start_s: float, stop_s: float) -> None:
        """Print the final answer."""
        n_lost = self.session.n_lost
        self._print("final", onset_s=start_s, stop_s=stop_s, n_lost=n_lost, **verdict.to_dict())

    def _print(self, type_: str, /, **facts: Any) -> None:
        rounded = {k: round(v, 6) if isinstance(v, float) else v for k, v in facts.items()}
        with self._lock:
            print(json.dumps({"type": type_, **rounded}), flush=True)


class TerminalView(TextView):
    """Draw a live display in the terminal, at most ten times a second."""

    def __init__(self, session: Session, source: str, console: Console) -> None:
        super().__init__(session, source)
        self._live = Live(console=console, auto_refresh=False)
        self._notices = deque[str](maxlen=3)
        self._events = deque[str](maxlen=3)
        self._last_draw, self._ms = 0.0, deque[float](maxlen=100)

    def __enter__(self) -> Self:
        """Start drawing."""
        self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop drawing; the last state stays on the terminal."""
        self._draw()
        self._live.stop()

    def on_open(self) -> None:
        """Draw the empty display."""
        self._draw()

    def show(self, updates: Iterable[Event | WindowAnswer | Notice]) -> None:
        """Store the updates of a block, and redraw if the last drawing is at least 0.1 s old."""
        super().show(updates)
        now = time.monotonic()
        if now - self._last_draw >= 0.1:
            self._last_draw = now
            self._draw()

    def on_answer(self, update: WindowAnswer) -> None:
        """Store the computation time of an answer."""
        self._ms.append(update.compute_ms)

    def on_event(self, event: Event) -> None:
        """Store an event. A lift-off clears the answer, except during active exploration."""
        self._events.append(f"{self.seconds(event.sample):.3f} s {event.kind}")
        has_advice = self.answer is not None and isinstance(self.answer.verdict, ExplorationVerdict)
        if event.kind == "lift-off" and not has_advice:
            self.answer = None

    def on_notice(self, notice: Notice) -> None:
        """Store a notice."""
        self._notices.append(notice.message)

    def picture(self) -> Group:
        """Return the display of the current state."""
        recogniser = self.session.recogniser
        level, over_rest_db = recogniser.level if recogniser else (0.0, 0.0)
        t_s, phase = (
            (self.seconds(recogniser.n_samples), recogniser.phase) if recogniser else (0.0, "waiting")
        )
        style = {"moving": "bold green", "active": "bold", "pause": "yellow"}.get(phase, "")
        head = Text.assemble(
            (f"{self.source}  ", "dim"),
            f"{t_s:8.2f} s  ",
            (f"{phase:<9}", style),
            "  level ",
            (bar(over_rest_db / 60, 20) if over_rest_db else "", "cyan"),
            f" {level:.3g} {recogniser.unit if recogniser else ''}",
            f" ({over_rest_db:+.0f} dB over rest)" if over_rest_db else "",
        )
        median_ms = sorted(self._ms)[len(self._ms) // 2] if self._ms else 0.0
        foot = f"{counted(self.n_answers, 'answer')}, {median_ms:.2f} ms each, lost {self.session.n_lost}"
        return Group(
            head,
            _surfaces(self.answer) if self.answer else Text("no contact yet", "dim"),
            Text("; ".join([foot, *self._events]), "dim"),
            *(Text(f"notice: {message}", "yellow") for message in self._notices),
        )

    def _draw(self) -> None:
        self._live.update(self.picture(), refresh=True)


def view_of(session: Session, source: str, as_lines: bool, heartbeat_s: float) -> TextView:
    """Return the view of a session: JSON lines if `as_lines`, else a live display in a terminal or text."""
    if as_lines:
        return JsonView(session, source, heartbeat_s)
    console = Console()
    return TerminalView(session, source, console) if console.is_terminal else TextView(session, source)


class Publisher(Protocol):
    """Protocol of publishers of answers as JSON, such as `texclass.robot.AnswerPublisher`."""

    def publish(self, answer: dict[str, Any]) -> None:
        """Publish one answer."""


class TypedPublisher(Protocol):
    """Protocol of publishers of typed messages, such as `texclass.robot.SurfacePublisher`."""

    def publish_update(self, update: Event | WindowAnswer, time_of: Callable[[int], int]) -> None:
        """Publish one answer or event, given a function that returns the time stamp of a sample in ns."""


def show_and_publish(
    view: TextView,
    updates: Iterable[Event | WindowAnswer | Notice],
    publisher: Publisher | None,
    typed_publisher: TypedPublisher | None = None,
) -> None:
    """Show the events, answers and notices of a block, and publish its answers and events."""
    updates = tuple(updates)
    view.show(updates)
    # The clock of the computer gives the time of the last sample.
    end_s = time.time() - view.session.age_s
    for update in updates:
        if publisher is not None and isinstance(update, WindowAnswer):
            publisher.publish(view.facts(update))
        if typed_publisher is not None and not isinstance(update, Notice):
            typed_publisher.publish_update(update, partial(_time_ns, view.session, end_s))


def _time_ns(session: Session, end_s: float, sample: int) -> int:
    """Return the time stamp of a sample in nanoseconds, given that of the last sample in seconds."""
    assert session.recogniser is not None
    n_after = max(0, session.recogniser.n_samples - sample)
    return round(1e9 * (end_s - n_after / session.recogniser.fs))


def _surfaces(answer: WindowAnswer) -> Table:
    """Return a table of the five most probable surfaces, prediction sets, next gesture and first reasons."""
    verdict = answer.verdict
    best = sorted(verdict.probabilities.items(), key=lambda pair: -pair[1])[:5]
    table = Table.grid(padding=(0, 1))
    for i, (surface, p) in enumerate(best):
        style = "bold green" if i == 0 and verdict.sure else "bold" if i == 0 else ""
        mark = "unknown?" if i == 0 and verdict.unknown else "sure" if i == 0 and verdict.sure else ""
        table.add_row(Text(surface, style), Text(bar(p, 30), "green"), f"{100 * p:5.1f} %", mark)
    for level, members in describe_sets(verdict.prediction_sets, len(verdict.probabilities)).items():
        table.add_row(Text(f"{level}: {members}"))
    if isinstance(verdict, ExplorationVerdict) and verdict.advice is not None:
        table.add_row(Text(f"next: {verdict.advice}", "bold cyan"))
    for reason in answer.answer.reasons[:2]:
        table.add_row(Text(reason, "yellow"))
    return table


def describe_verdict(verdict: ContactVerdict) -> str:
    """Return a verdict as one line of text."""
    unknown = "unknown surface, most similar to " if verdict.unknown else ""
    certainty = ", sure" if verdict.sure else f" (or {verdict.runner_up})"
    unit, advice = "window", ""
    if isinstance(verdict, ExplorationVerdict):
        unit, advice = "gesture", f"; next: {verdict.advice}" if verdict.advice is not None else ""
    sets = describe_sets(verdict.prediction_sets, len(verdict.probabilities)).items()
    return (
        f"{unknown}{verdict.surface}, {100 * verdict.probability:.1f} %{certainty}, "
        f"after {verdict.contact_s:.2f} s, {counted(verdict.n_windows, unit)}{advice}"
    ) + "".join(f"; {level}: {members}" for level, members in sets)


def bar(share: float, length: int) -> str:
    """Return a bar of `length` characters, of which a fraction `share` is filled."""
    n = round(min(max(share, 0.0), 1.0) * length)
    return "█" * n + "·" * (length - n)
