"""The messages in `ros2/texclass_msgs`: types according to rosidl and DDS, bytes, and content."""

import importlib.util
import json
import re
import subprocess
import sys
import types
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from cyclonedds import idl
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from texclass.recognition import Answer, Event, Evidence, WindowAnswer
from texclass.recognition.live.contact import Kind
from texclass.robot.answer_messages import EVENT_KINDS, answer_message, event_message
from texclass.robot.dds import dds_type, make_message, message_class

MESSAGES = Path(__file__).resolve().parents[3] / "ros2" / "texclass_msgs"
NAMES = sorted(path.stem for path in (MESSAGES / "msg").glob("*.msg"))
ROSIDL_PYTHONS = ("/usr/bin/python3", sys.executable)
"""Interpreters that may have rosidl; Debian installs it for its own."""


@pytest.fixture(scope="session")
def rosidl(tmp_path_factory):
    """Return the types that rosidl derives from the .msg files."""
    folder = tmp_path_factory.mktemp("rosidl")
    script = Path(__file__).with_name("rosidl_types.py")
    for python in ROSIDL_PYTHONS:
        check = [python, "-c", "import rosidl_adapter, rosidl_parser, em, lark"]
        if Path(python).exists() and not subprocess.run(check, capture_output=True, check=False).returncode:
            result = subprocess.run(
                [python, script, MESSAGES, folder], capture_output=True, text=True, check=False, env={}
            )
            assert not result.returncode, result.stderr
            return json.loads((folder / "types.json").read_text(encoding="utf-8"))
    pytest.skip("rosidl is not installed (Debian: python3-rosidl python3-empy python3-lark)")


def described(kind):
    """Return the type of a field of an IdlStruct in the words of rosidl."""
    if isinstance(kind, type) and issubclass(kind, idl.IdlStruct):
        return kind.__idl_typename__.replace("::dds_::", "::").removesuffix("_")
    if kind in (str, bool):
        return {str: "string", bool: "boolean"}[kind]
    *_, last = get_args(kind)
    if isinstance(last, str):
        return {"float64": "double"}.get(last, last)
    return f"sequence<{described(last.subtype)}>"


def class_of(name, rosidl):
    """Return an IdlStruct that is built from the types of rosidl, not from those of texclass."""
    package, _, type_name = name.split("::")
    if package != "texclass_msgs":
        return message_class(f"{package}/msg/{type_name}")

    def kind(text):
        if text.startswith("sequence<"):
            return idl.types.sequence[kind(text[len("sequence<") : -1])]
        if "::" in text:
            return class_of(text, rosidl)
        basic = {"string": str, "boolean": bool, "double": idl.types.float64}
        return basic.get(text) or getattr(idl.types, text)

    members = {name: kind(text) for name, text in rosidl[type_name]["fields"]}
    body = {"__annotations__": members, "__module__": __name__}
    body |= {name: field(default=None) for name in members}
    keywords = {"typename": dds_type(f"texclass_msgs/msg/{type_name}")}
    class_ = types.new_class(type_name, (idl.IdlStruct,), keywords, lambda space: space.update(body))
    return dataclass(class_)


WINDOW = Answer(
    "window",
    "oak",
    0.98,
    "cork",
    unknown=False,
    p_known=0.5,
    probabilities={"cork": 0.02, "oak": 0.98},
    reasons=("undefined: hardness",),
)


@pytest.fixture
def update():
    verdict = Evidence(("cork", "oak"), window_s=0.25).add(WINDOW, contact_s=0.25)
    sets = {0.9: ("oak",), 0.95: ("oak", "cork")}
    verdict = type(verdict)(**vars(verdict) | {"prediction_sets": sets})
    return WindowAnswer(1000, 1250, 1260, WINDOW, verdict, onset=1000, compute_ms=1.0)


@pytest.fixture
def messages(update):
    def time_of(sample):
        return 1_700_000_000 * 10**9 + sample * 10**6

    event = Event("tap", sample=900, n_received=1000, end=950, message="of hand")
    answer = answer_message(make_message, update, time_of, "tool")
    return {
        "SurfaceAnswer": answer,
        "ContactEvent": event_message(make_message, event, time_of, "tool"),
        "PredictionSet": answer.prediction_sets[1],
    }


def test_every_message_is_built(rosidl):
    listed = re.findall(r'"msg/(\w+)\.msg"', (MESSAGES / "CMakeLists.txt").read_text(encoding="utf-8"))
    assert sorted(listed) == sorted(rosidl) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_dds_types_equal_those_of_rosidl(rosidl, name):
    ours = message_class(f"texclass_msgs/msg/{name}")
    assert rosidl[name]["name"] == described(ours)
    annotations = ours.__annotations__
    assert rosidl[name]["fields"] == [[f.name, described(annotations[f.name])] for f in fields(ours)]


@pytest.mark.parametrize("name", NAMES)
def test_bytes_decode_with_the_types_of_rosidl(rosidl, messages, name):
    raw = messages[name].serialize(use_version_2=False)
    theirs = class_of(f"texclass_msgs::msg::{name}", rosidl)
    decoded = theirs.deserialize(raw)
    assert decoded.serialize(use_version_2=False) == raw
    assert plain(decoded) == plain(messages[name])


@pytest.mark.parametrize("name", NAMES)
def test_bytes_decode_with_another_implementation_of_cdr(messages, name):
    store = get_typestore(Stores.ROS2_HUMBLE)
    for path in (MESSAGES / "msg").glob("*.msg"):
        store.register(get_types_from_msg(path.read_text(encoding="utf-8"), f"texclass_msgs/msg/{path.stem}"))
    raw = messages[name].serialize(use_version_2=False)
    assert plain(store.deserialize_cdr(raw, f"texclass_msgs/msg/{name}")) == plain(messages[name])


def plain(value):
    """Return a message as nested dictionaries and lists."""
    if hasattr(value, "__dataclass_fields__"):
        names = [name for name in value.__dataclass_fields__ if name.islower() and not name.startswith("__")]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def test_constants_of_events_are_the_kinds_of_the_stream(rosidl):
    constants = {
        name.lower().replace("_", "-"): value for name, value in rosidl["ContactEvent"]["constants"].items()
    }
    assert constants == EVENT_KINDS
    assert set(EVENT_KINDS) == set(get_args(Kind))


def test_an_answer_contains_the_verdict(messages, update):
    answer, verdict = messages["SurfaceAnswer"], update.verdict
    assert {
        name: getattr(answer, name) for name in ("surface", "probability", "runner_up", "unknown", "sure")
    } == {name: getattr(verdict, name) for name in ("surface", "probability", "runner_up", "unknown", "sure")}
    assert dict(zip(answer.surfaces, answer.probabilities, strict=True)) == verdict.probabilities
    assert {s.coverage: tuple(s.surfaces) for s in answer.prediction_sets} == verdict.prediction_sets
    assert (answer.header.stamp.nanosec, answer.window_start.nanosec) == (250_000_000, 0)
    assert (answer.header.frame_id, answer.p_known, answer.reasons) == ("tool", 0.5, ["undefined: hardness"])


def test_an_event_contains_its_times(messages):
    event = messages["ContactEvent"]
    assert event.kind == EVENT_KINDS["tap"]
    times = [event.header.stamp, event.tap_end, event.detection_time]
    assert [(t.sec, t.nanosec // 10**6) for t in times] == [
        (1_700_000_000, 900),
        (1_700_000_000, 950),
        (1_700_000_001, 0),
    ]


def test_the_classifier_of_messages_needs_no_extra():
    """A robot with ROS needs no extra of texclass."""
    blocked = "import sys; sys.modules.update(dict.fromkeys(['cyclonedds', 'rosbags', 'mcap', 'rclpy']))"
    code = f"{blocked}; import texclass.robot.message_classifier"
    assert importlib.util.find_spec("texclass.robot.message_classifier")
    subprocess.run([sys.executable, "-c", code], check=True)
