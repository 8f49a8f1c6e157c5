"""Messages of ROS 2 for answers, events and diagnostics, independent of the library that sends them.

A `Make` function creates a message from the name of its type and its fields. The node in the folder `ros2`
uses the classes of ROS, and the publisher without ROS uses those of `texclass.robot.dds`.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from texclass.recognition import ContactVerdict, Event, WindowAnswer

Make = Callable[..., Any]
"""Function that creates a message from the name of its type and its fields, given as keywords."""
TimeOf = Callable[[int], int]
"""Function that returns the time stamp of a sample of the stream, in nanoseconds."""
OK, WARN, ERROR = 0, 1, 2
"""Levels of `diagnostic_msgs/DiagnosticStatus`."""
EVENT_KINDS = {"contact": 1, "stroke": 2, "tap": 3, "lift-off": 4, "break": 5}
"""Kind of an event -> value of `texclass_msgs/ContactEvent.kind`."""


def header(make: Make, stamp_ns: int, frame: str = "") -> Any:
    """Return a `std_msgs/Header`."""
    return make("std_msgs/msg/Header", stamp=time_message(make, stamp_ns), frame_id=frame)


def time_message(make: Make, stamp_ns: int) -> Any:
    """Return a `builtin_interfaces/Time`."""
    sec, nanosec = divmod(stamp_ns, 10**9)
    return make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def answer_message(make: Make, update: WindowAnswer, time_of: TimeOf, frame: str = "") -> Any:
    """Return a `texclass_msgs/SurfaceAnswer`.

    Parameters
    ----------
    make : callable
        Function that creates a message, see `Make`.
    update : WindowAnswer
        Answer for a window of a stream, and for its contact.
    time_of : callable
        Function that returns the time stamp of a sample in nanoseconds.
    frame : str
        Frame of the sensor.

    Examples
    --------
    >>> from texclass.recognition import Answer, Evidence, WindowAnswer
    >>> p = {"cork": 0.02, "oak": 0.98}
    >>> answer = Answer("window", "oak", 0.98, "cork", unknown=False, p_known=0.5, probabilities=p)
    >>> verdict = Evidence(("cork", "oak")).add(answer, contact_s=1.0)
    >>> update = WindowAnswer(1200, 2200, 2210, answer, verdict, onset=1200, compute_ms=1.3)
    >>> message = answer_message(lambda type_name, **fields: fields, update, lambda sample: sample * 10**6)
    >>> message["surface"], message["header"]["stamp"]
    ('oak', {'sec': 2, 'nanosec': 200000000})
    """
    verdict = update.verdict
    return make(
        "texclass_msgs/msg/SurfaceAnswer",
        header=header(make, time_of(update.stop), frame),
        contact_start=time_message(make, time_of(update.onset)),
        window_start=time_message(make, time_of(update.start)),
        surface=verdict.surface,
        probability=float(verdict.probability),
        runner_up=verdict.runner_up,
        unknown=bool(verdict.unknown),
        sure=bool(verdict.sure),
        p_known=float(update.answer.p_known),
        surfaces=[*verdict.probabilities],
        probabilities=[*map(float, verdict.probabilities.values())],
        prediction_sets=[
            make("texclass_msgs/msg/PredictionSet", coverage=float(coverage), surfaces=[*surfaces])
            for coverage, surfaces in verdict.prediction_sets.items()
        ],
        n_windows=int(verdict.n_windows),
        contact_s=float(verdict.contact_s),
        previous_surface=verdict.previous_surface,
        reasons=[*update.answer.reasons],
    )


def event_message(make: Make, event: Event, time_of: TimeOf, frame: str = "") -> Any:
    """Return a `texclass_msgs/ContactEvent`.

    Parameters
    ----------
    make : callable
        Function that creates a message, see `Make`.
    event : Event
        Event of a stream.
    time_of : callable
        Function that returns the time stamp of a sample in nanoseconds.
    frame : str
        Frame of the sensor.

    Examples
    --------
    >>> from texclass.recognition import Event
    >>> event = Event("lift-off", sample=1180, n_received=1400, end=1180)
    >>> message = event_message(lambda type_name, **fields: fields, event, lambda sample: sample * 10**6)
    >>> message["kind"], message["detection_time"]
    (4, {'sec': 1, 'nanosec': 400000000})
    """
    return make(
        "texclass_msgs/msg/ContactEvent",
        header=header(make, time_of(event.sample), frame),
        kind=EVENT_KINDS[event.kind],
        tap_end=time_message(make, time_of(event.end)),
        detection_time=time_message(make, time_of(event.n_received)),
        message=event.message,
    )


def status_message(
    make: Make, name: str, level: int, message: str, values: Mapping[str, Any], hardware: str = ""
) -> Any:
    """Return a `diagnostic_msgs/DiagnosticStatus`; values that are not text are written as JSON.

    Examples
    --------
    >>> make = lambda type_name, /, **fields: fields
    >>> status_message(make, "texclass: input", OK, "ok", {"rate (Hz)": 200.0})["values"]
    [{'key': 'rate (Hz)', 'value': '200.0'}]
    """
    texts = {key: value if isinstance(value, str) else json.dumps(value) for key, value in values.items()}
    pairs = [make("diagnostic_msgs/msg/KeyValue", key=key, value=text) for key, text in texts.items()]
    return make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=name,
        message=message,
        hardware_id=hardware,
        values=pairs,
    )


def diagnostics_message(make: Make, statuses: Sequence[Any], stamp_ns: int) -> Any:
    """Return a `diagnostic_msgs/DiagnosticArray`."""
    return make("diagnostic_msgs/msg/DiagnosticArray", header=header(make, stamp_ns), status=[*statuses])


def surface_status(make: Make, name: str, verdict: ContactVerdict | None) -> Any:
    """Return the `diagnostic_msgs/DiagnosticStatus` of the last answer, with level WARN if it is unknown."""
    if verdict is None:
        return status_message(make, name, OK, "no answer yet", {})
    message = "unknown surface" if verdict.unknown else verdict.surface
    return status_message(make, name, WARN if verdict.unknown else OK, message, verdict.to_dict())
