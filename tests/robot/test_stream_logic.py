"""The reference of what a stream does around its windows: texclass's own vectors, and a whole stream."""

import json
import runpy
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from toy_surfaces import signal

from texclass.recognition import OnlineRecogniser
from texclass.robot import export_onnx

ROOT = Path(__file__).parents[2]
VECTORS = json.loads((ROOT / "examples" / "stream_vectors.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def logic():
    return runpy.run_path(str(ROOT / "examples" / "stream_logic.py"))


def test_the_vectors_are_what_texclass_says():
    made = runpy.run_path(str(ROOT / "benchmarks" / "stream_vectors.py"))["made"]()
    # The last digits are of the processor.
    said, kept = (
        json.loads(json.dumps(vectors), parse_float=lambda x: round(float(x), 9))
        for vectors in (made, VECTORS)
    )
    assert said == kept


def test_every_transition_is_in_the_vectors():
    kinds = [[event["kind"] for event in vector["events"]] for vector in VECTORS["contact"]]
    assert {kind for told in kinds for kind in told} == {"contact", "stroke", "lift-off", "break"}
    assert [] in kinds
    assert {vector["constants"]["in_contact"] for vector in VECTORS["contact"]} == {True, False, None}
    verdicts = [v for vector in VECTORS["evidence"] for v in vector["verdicts"]]
    found = {(v["unknown"], v["sure"]) for v in verdicts}
    assert found == {(False, False), (False, True), (True, False)}  # an unknown surface is never sure


@pytest.mark.parametrize("vector", VECTORS["contact"], ids=lambda vector: vector["name"])
def test_the_reference_tells_the_events_of_the_vectors(vector, logic):
    contact, at, told, states = logic["Contact"](vector["constants"]), 0, [], set()
    size = vector["constants"]["bin_samples"]
    for n, power in vector["stretches"]:
        if n < 0:
            told += [(*event, at) for event in contact.interrupt(at, -n, VECTORS["fs_hz"])]
            at -= n
        for _ in range(max(n, 0)):
            told += [(*event, at + size) for event in contact.step(at, at + size, power, vector["white"])]
            states.add(contact.state)
            at += size
    expected = [(event["kind"], event["sample"], event["known"]) for event in vector["events"]]
    # A contact that goes on after a break is known when its first bin is there, in both.
    assert told == expected
    assert states >= ({"BEGUN"} if expected[:1] and expected[0][1] == 0 else {"LISTENING", "REST", "TOUCHED"})


@pytest.mark.parametrize("vector", VECTORS["evidence"], ids=lambda vector: vector["name"])
def test_the_reference_gives_the_verdicts_of_the_vectors(vector, logic):
    evidence = logic["Evidence"](vector["constants"], len(vector["probabilities"][0]))
    for _ in range(2):
        for p, unknown, verdict in zip(
            vector["probabilities"], vector["unknown"], vector["verdicts"], strict=True
        ):
            together, strange, sure = evidence.add(p, unknown)
            assert together == pytest.approx(verdict["probabilities"], abs=1e-12)
            assert (strange, sure) == (verdict["unknown"], verdict["sure"])
        evidence.reset()


def test_the_reference_and_the_exported_file_answer_a_stream_as_texclass_does(logic, touch_model, tmp_path):
    model = touch_model
    exported = export_onnx(model, tmp_path / "windows.onnx", start="samples")
    session = onnxruntime.InferenceSession(exported.path, providers=["CPUExecutionProvider"])
    constants = json.loads(session.get_modelmeta().custom_metadata_map["texclass.stream"])
    rest = 1e-3 * np.random.default_rng(3).standard_normal(2000)
    stream = np.concatenate([rest, signal(200.0, 1, 6000), rest, rest, signal(800.0, 2, 5000), rest, rest])
    stream = stream.astype(np.float32)

    live, expected = OnlineRecogniser(model), []
    for update in live.push(stream.astype(np.float64)):
        if hasattr(update, "verdict"):
            verdict = update.verdict
            said = (verdict.surface, verdict.unknown, verdict.sure)
            expected.append((update.start, update.stop, *said, verdict.probability))
        else:
            expected.append((update.kind, update.sample))

    told, bins = [], logic["Bins"](constants["contact"], 1)
    contact, windows = logic["Contact"](constants["contact"]), logic["Windows"](constants)
    evidence = logic["Evidence"](constants["evidence"], len(model.surfaces))
    for x in stream.tolist():
        full = bins.push([x])
        if full is None:
            continue
        for event in contact.step(*full, bins.white):
            windows.after(*event)
            if event[0] == "lift-off":
                evidence.reset()
            told.append(event)
        for start, stop in windows.ready(bins.at, contact.until) if contact.moving else ():
            _, p, _, unknown = session.run(None, {"samples": stream[None, None, start:stop]})
            together, strange, sure = evidence.add(p[0].tolist(), bool(unknown[0]))
            best = int(np.argmax(together))
            told.append((start, stop, model.surfaces[best], strange, sure, together[best]))
    assert [event[0] for event in told if len(event) == 2] == ["contact", "lift-off", "contact", "lift-off"]
    assert len(told) == len(expected) > 20
    late = [b[0] - a[0] for a, b in zip(expected, told, strict=True) if len(a) > 2]
    assert max(map(abs, late)) <= 2 * constants["contact"]["bin_samples"]
    for a, b in zip(expected, told, strict=True):
        assert a[-4:-1] == b[-4:-1] if len(a) > 2 else a[0] == b[0]
        if len(a) > 2 and a[0] == b[0]:
            assert a[-1] == pytest.approx(b[-1], abs=1e-5)
