"""What `texclass stream` shows: a live picture in a terminal, lines elsewhere, JSON for machines."""

import json
import math
import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import Any, Protocol, Self

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from texclass.recognition import ContactVerdict, Event, ExploredVerdict, Notice, Session, WindowAnswer
from texclass.recognition.conformal import told as sets_told
from texclass.reporting.wording import counted

REFRESH_S = 0.1
N_SHOWN = 5
BAR = 30
LEVEL_DB = 60.0
"""Full length of the level's bar."""


class Lines:
    """Follows a session in lines, for where nothing can be drawn: events, notices, each verdict that differs.

    Parameters
    ----------
    session : Session
        What is followed.
    source : str
        Its name.
    """

    def __init__(self, session: Session, source: str) -> None:
        self.session, self.source = session, source
        self.heard: WindowAnswer | None = None
        self.final: tuple[ContactVerdict, float, float] | None = None
        """The last verdict, and from when to when it was felt (s)."""
        self.contacts: dict[int, dict[str, Any]] | None = None
        """What was said last of each contact, by its onset; None where nobody asks: a stream may not end."""
        self.n_answers = 0
        self._said: tuple[object, ...] = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Nothing is open."""

    def listening(self) -> None:
        """Say that the source is open, on standard error."""
        typer.echo(f"listening to {self.source}", err=True)

    def facts(self, update: WindowAnswer) -> dict[str, Any]:
        """Return what a machine reads of an answer; `age_s` is how old the last sample it felt is."""
        fs = self.session.live.fs if self.session.live else math.nan
        return {
            "t_s": self.seconds(update.known),
            "start_s": self.seconds(update.start),
            "stop_s": self.seconds(update.stop),
            "onset_s": self.seconds(update.onset),
            "age_s": (update.known - update.stop) / fs + self.session.age_s,
            **update.verdict.to_dict(),
            "reasons": list(update.answer.reasons),
        }

    def show(self, found: Iterable[Event | WindowAnswer | Notice]) -> None:
        """Take in what a block has told."""
        for update in found:
            if isinstance(update, WindowAnswer):
                self.n_answers += 1
                self.heard = update
                if self.contacts is not None:
                    self.contacts[update.onset] = self.facts(update)
                self.final = (update.verdict, self.seconds(update.onset), self.seconds(update.stop))
                self.answered(update)
            elif isinstance(update, Event):
                self.happened(update)
            else:
                self.noticed(update)

    def end(self) -> bool:
        """Say the final answer, below all that was shown, and return whether there is one."""
        if self.final is None:
            typer.echo("no answer: nothing was felt for long enough", err=True)
            return False
        self.ended(*self.final)
        return True

    def seconds(self, sample: int) -> float:
        """Return when a sample was, in seconds since the start of the stream."""
        live = self.session.live
        return sample / live.fs if live else 0.0

    def answered(self, update: WindowAnswer) -> None:
        """Show an answer: its verdict when the surface changes, or when it becomes sure."""
        verdict = update.verdict
        if (now := (update.onset, verdict.surface, verdict.sure, verdict.unknown)) != self._said:
            self._said = now
            typer.echo(f"{self.seconds(update.known):9.3f} s  {told(verdict)}")

    def happened(self, event: Event) -> None:
        """Show an event."""
        what = f" ({event.what})" if event.what else ""
        typer.echo(f"{self.seconds(event.sample):9.3f} s  {event.kind}{what}")

    def noticed(self, notice: Notice) -> None:
        """Show what is wrong, on standard error."""
        typer.echo(f"notice: {notice.what}", err=True)

    def ended(self, verdict: ContactVerdict, start_s: float, stop_s: float) -> None:
        """Show the final answer."""
        typer.echo(f"final: {told(verdict)}, felt from {start_s:.3f} s to {stop_s:.3f} s")


class JsonLines(Lines):
    """A JSON object a line; `type` is listening, answer, event, notice, heartbeat or final.

    Parameters
    ----------
    session, source
        See `Lines`.
    heartbeat_s : float
        A line says that the program lives, and how old the last sample is, every so many seconds; 0: never.
    """

    def __init__(self, session: Session, source: str, heartbeat_s: float = 0.0) -> None:
        super().__init__(session, source)
        self._heartbeat_s, self._over, self._lock = heartbeat_s, threading.Event(), threading.Lock()

    def __enter__(self) -> Self:
        """Begin the heartbeat, which does not depend on samples that come."""
        if self._heartbeat_s > 0:
            threading.Thread(target=self._beat, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        """End the heartbeat."""
        self._over.set()

    def _beat(self) -> None:
        while not self._over.wait(self._heartbeat_s):
            live, age_s = self.session.live, self.session.age_s
            t_s, phase = (self.seconds(live.n_samples), live.phase) if live else (0.0, "waiting")
            age = age_s if math.isfinite(age_s) else None
            try:
                self._print("heartbeat", t_s=t_s, phase=phase, age_s=age, n_answers=self.n_answers)
            except OSError:  # nobody reads any more: the main thread will see it
                return

    def listening(self) -> None:
        """Print that the source is open."""
        self._print("listening", source=self.source)

    def answered(self, update: WindowAnswer) -> None:
        """Print an answer: its window, what it says alone, and the verdict of the contact."""
        alone = {k: v for k, v in update.answer.to_dict().items() if k not in ("recording", "reasons")}
        self._print("answer", **self.facts(update), window=alone, ms=round(update.ms, 3))

    def happened(self, event: Event) -> None:
        """Print an event: when it was, and when it was known."""
        self._print(
            "event", t_s=self.seconds(event.known), kind=event.kind, at_s=self.seconds(event.sample),
            what=event.what,
        )  # fmt: skip

    def noticed(self, notice: Notice) -> None:
        """Print what is wrong."""
        self._print("notice", t_s=notice.t_s, what=notice.what)

    def ended(self, verdict: ContactVerdict, start_s: float, stop_s: float) -> None:
        """Print the final answer."""
        n_lost = self.session.n_lost
        self._print("final", onset_s=start_s, stop_s=stop_s, n_lost=n_lost, **verdict.to_dict())

    def _print(self, type_: str, /, **facts: Any) -> None:
        rounded = {k: round(v, 6) if isinstance(v, float) else v for k, v in facts.items()}
        with self._lock:
            print(json.dumps({"type": type_, **rounded}), flush=True)


class Picture(Lines):
    """A picture in the terminal, drawn anew ten times a second at most."""

    def __init__(self, session: Session, source: str, console: Console) -> None:
        super().__init__(session, source)
        self._live = Live(console=console, auto_refresh=False)
        self._notices = deque[str](maxlen=3)
        self._events = deque[str](maxlen=3)
        self._drawn, self._ms = 0.0, deque[float](maxlen=100)

    def __enter__(self) -> Self:
        """Begin to draw."""
        self._live.start()
        return self

    def listening(self) -> None:
        """Draw that nothing was felt yet."""
        self._live.update(self.picture(), refresh=True)

    def __exit__(self, *error: object) -> None:
        """Leave the last picture."""
        self._live.update(self.picture(), refresh=True)
        self._live.stop()

    def show(self, found: Iterable[Event | WindowAnswer | Notice]) -> None:
        """Take in what a block has told, and draw if it is time."""
        super().show(found)
        now = time.monotonic()
        if now - self._drawn >= REFRESH_S:
            self._drawn = now
            self._live.update(self.picture(), refresh=True)

    def answered(self, update: WindowAnswer) -> None:
        """Remember what an answer took."""
        self._ms.append(update.ms)

    def happened(self, event: Event) -> None:
        """Remember an event; a lift-off ends what is shown of the contact."""
        self._events.append(f"{self.seconds(event.sample):.3f} s {event.kind}")
        asks = self.heard is not None and isinstance(self.heard.verdict, ExploredVerdict)
        if event.kind == "lift-off" and not asks:
            self.heard = None

    def noticed(self, notice: Notice) -> None:
        """Remember what is wrong."""
        self._notices.append(notice.what)

    def picture(self) -> Group:
        """Return what is drawn now."""
        live = self.session.live
        level, above = live.level if live else (0.0, 0.0)
        at_s, phase = (self.seconds(live.n_samples), live.phase) if live else (0.0, "waiting")
        unit = live.unit if live else ""
        head = Text.assemble(
            (f"{self.source}  ", "dim"), f"{at_s:8.2f} s  ", (f"{phase:<9}", PHASE_STYLE.get(phase, "")),
            "  level ", (bar(above / LEVEL_DB, 20) if above else "", "cyan"), f" {level:.3g} {unit}",
            f" ({above:+.0f} dB over rest)" if above else "",
        )  # fmt: skip
        lines: list[Any] = [head, _surfaces(self.heard) if self.heard else Text("nothing felt yet", "dim")]
        typical = sorted(self._ms)[len(self._ms) // 2] if self._ms else 0.0
        foot = f"{counted(self.n_answers, 'answer')}, {typical:.2f} ms each, lost {self.session.n_lost}"
        lines.append(Text("; ".join([foot, *self._events]), "dim"))
        lines += [Text(f"notice: {what}", "yellow") for what in self._notices]
        return Group(*lines)


PHASE_STYLE = {"moving": "bold green", "touched": "bold", "pause": "yellow"}


def view_of(session: Session, source: str, as_lines: bool, heartbeat_s: float) -> Lines:
    """Return the way to show a session: JSON if asked for, a picture in a terminal, else lines."""
    if as_lines:
        return JsonLines(session, source, heartbeat_s)
    console = Console()
    return Picture(session, source, console) if console.is_terminal else Lines(session, source)


class Publisher(Protocol):
    """Publishes answers, as `texclass.robot.AnswerPublisher` does."""

    def publish(self, answer: dict[str, Any]) -> None:
        """Publish one answer."""


def show_and_publish(
    view: Lines, updates: Iterable[Event | WindowAnswer | Notice], publisher: Publisher | None
) -> None:
    """Show the events, answers and notices of a block, and publish its answers if there is a publisher."""
    updates = tuple(updates)
    view.show(updates)
    if publisher is not None:
        for update in updates:
            if isinstance(update, WindowAnswer):
                publisher.publish(view.facts(update))


def _surfaces(heard: WindowAnswer) -> Table:
    """Return the likeliest surfaces of a contact with their probabilities, and what is to be known of it."""
    verdict = heard.verdict
    best = sorted(verdict.probabilities.items(), key=lambda pair: -pair[1])[:N_SHOWN]
    table = Table.grid(padding=(0, 1))
    for i, (surface, p) in enumerate(best):
        style = "bold green" if i == 0 and verdict.sure else "bold" if i == 0 else ""
        mark = "unknown?" if i == 0 and verdict.unknown else "sure" if i == 0 and verdict.sure else ""
        table.add_row(Text(surface, style), Text(bar(p, BAR), "green"), f"{100 * p:5.1f} %", mark)
    for level, members in sets_told(verdict.sets, len(verdict.probabilities)).items():
        table.add_row(Text(f"{level}: {members}"))
    if isinstance(verdict, ExploredVerdict) and verdict.advice is not None:
        table.add_row(Text(f"next: {verdict.advice}", "bold cyan"))
    for reason in heard.answer.reasons[:2]:
        table.add_row(Text(reason, "yellow"))
    return table


def told(verdict: ContactVerdict) -> str:
    """Return a verdict in words."""
    unknown = "unknown surface, most like " if verdict.unknown else ""
    sure = ", sure" if verdict.sure else f" (or {verdict.runner_up})"
    what, following = "window", ""
    if isinstance(verdict, ExploredVerdict):
        what, following = "gesture", f"; next: {verdict.advice}" if verdict.advice is not None else ""
    sets = sets_told(verdict.sets, len(verdict.probabilities)).items()
    return (
        f"{unknown}{verdict.surface}, {100 * verdict.probability:.1f} %{sure}, "
        f"after {verdict.felt_s:.2f} s, {counted(verdict.n_windows, what)}{following}"
    ) + "".join(f"; {level}: {members}" for level, members in sets)


def bar(share: float, length: int) -> str:
    """Return a bar of `length` characters, filled to a share of it."""
    n = round(min(max(share, 0.0), 1.0) * length)
    return "█" * n + "·" * (length - n)
