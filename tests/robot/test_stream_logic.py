"""The reference implementation of the stream logic: test vectors, and a complete stream."""

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


def test_the_stored_vectors_equal_those_of_texclass():
    vectors = runpy.run_path(str(ROOT / "benchmarks" / "stream_vectors.py"))["all_vectors"]()
    # The last digits depend on the processor.
    current, stored = (
        json.loads(json.dumps(item), parse_float=lambda x: round(float(x), 9)) for item in (vectors, VECTORS)
    )
    assert current == stored


def test_every_transition_is_in_the_vectors():
    kinds = [[event["kind"] for event in vector["events"]] for vector in VECTORS["contact"]]
    assert {kind for names in kinds for kind in names} == {"contact", "stroke", "lift-off", "break"}
    assert [] in kinds
    assert {vector["constants"]["in_contact"] for vector in VECTORS["contact"]} == {True, False, None}
    verdicts = [v for vector in VECTORS["evidence"] for v in vector["verdicts"]]
    combinations = {(v["unknown"], v["sure"]) for v in verdicts}
    assert combinations == {(False, False), (False, True), (True, False)}  # an unknown surface is never sure


@pytest.mark.parametrize("vector", VECTORS["contact"], ids=lambda vector: vector["name"])
def test_the_reference_detects_the_events_of_the_vectors(vector, logic):
    detector, start, events, states = logic["ContactDetector"](vector["constants"]), 0, [], set()
    size = vector["constants"]["bin_samples"]
    for n, power in vector["levels"]:
        if n < 0:
            events += [(*event, start) for event in detector.interrupt(start, -n, VECTORS["fs_hz"])]
            start -= n
        for _ in range(max(n, 0)):
            new_events = detector.step(start, start + size, power, vector["is_white"])
            events += [(*event, start + size) for event in new_events]
            states.add(detector.state)
            start += size
    expected = [(event["kind"], event["sample"], event["n_received"]) for event in vector["events"]]
    assert events == expected
    starts_in_contact = expected[:1] and expected[0][1] == 0
    assert states >= ({"INITIAL"} if starts_in_contact else {"STARTING", "REST", "ACTIVE"})


@pytest.mark.parametrize("vector", VECTORS["evidence"], ids=lambda vector: vector["name"])
def test_the_reference_returns_the_verdicts_of_the_vectors(vector, logic):
    evidence = logic["Evidence"](vector["constants"], len(vector["probabilities"][0]))
    for _ in range(2):
        for p, unknown, verdict in zip(
            vector["probabilities"], vector["unknown"], vector["verdicts"], strict=True
        ):
            probabilities, is_unknown, is_sure = evidence.add(p, unknown)
            assert probabilities == pytest.approx(verdict["probabilities"], abs=1e-12)
            assert (is_unknown, is_sure) == (verdict["unknown"], verdict["sure"])
        evidence.reset()


def test_the_reference_with_the_exported_file_has_the_same_answers_as_texclass(logic, window_model, tmp_path):
    model = window_model
    exported = export_onnx(model, tmp_path / "windows.onnx", start="samples")
    session = onnxruntime.InferenceSession(exported.path, providers=["CPUExecutionProvider"])
    constants = json.loads(session.get_modelmeta().custom_metadata_map["texclass.stream"])
    rest = 1e-3 * np.random.default_rng(3).standard_normal(2000)
    stream = np.concatenate([rest, signal(200.0, 1, 6000), rest, rest, signal(800.0, 2, 5000), rest, rest])
    stream = stream.astype(np.float32)

    recogniser, expected = OnlineRecogniser(model), []
    for update in recogniser.push(stream.astype(np.float64)):
        if hasattr(update, "verdict"):
            verdict = update.verdict
            facts = (verdict.surface, verdict.unknown, verdict.sure, verdict.probability)
            expected.append((update.start, update.stop, *facts))
        else:
            expected.append((update.kind, update.sample))

    updates, bins = [], logic["Bins"](constants["contact"], 1)
    detector, windows = logic["ContactDetector"](constants["contact"]), logic["Windows"](constants)
    evidence = logic["Evidence"](constants["evidence"], len(model.surfaces))
    for x in stream.tolist():
        complete_bin = bins.push([x])
        if complete_bin is None:
            continue
        for event in detector.step(*complete_bin, bins.is_white):
            windows.handle_event(*event)
            if event[0] == "lift-off":
                evidence.reset()
            updates.append(event)
        for start, stop in windows.ready(bins.n_samples, detector.active_stop) if detector.is_moving else ():
            _, p, _, unknown = session.run(None, {"samples": stream[None, None, start:stop]})
            probabilities, is_unknown, is_sure = evidence.add(p[0].tolist(), bool(unknown[0]))
            best = int(np.argmax(probabilities))
            updates.append((start, stop, model.surfaces[best], is_unknown, is_sure, probabilities[best]))
    events = [update[0] for update in updates if len(update) == 2]
    assert events == ["contact", "lift-off", "contact", "lift-off"]
    assert len(updates) == len(expected) > 20
    delays = [b[0] - a[0] for a, b in zip(expected, updates, strict=True) if len(a) > 2]
    assert max(map(abs, delays)) <= 2 * constants["contact"]["bin_samples"]
    for a, b in zip(expected, updates, strict=True):
        assert a[-4:-1] == b[-4:-1] if len(a) > 2 else a[0] == b[0]
        if len(a) > 2 and a[0] == b[0]:
            assert a[-1] == pytest.approx(b[-1], abs=1e-5)
