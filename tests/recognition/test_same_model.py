"""The same recordings give the same model: no choice hangs on how busy a machine is."""

import json
import subprocess
import sys
from itertools import count
from zipfile import ZipFile

import pytest
from toy_surfaces import pipeline, surfaces

from texclass.experiment import cost
from texclass.recognition import train
from texclass.recognition.model_files import MANIFEST


def _told(path):
    """Return the members of a model file, date of each, and its facts but for measured costs."""
    with ZipFile(path) as archive:
        members = {m.filename: (m.date_time, archive.read(m)) for m in archive.infolist()}
    facts = json.loads(members.pop(MANIFEST)[1])
    assert set(facts.pop("cost")) == {"segmentation_ms", "features_ms", "classifier_ms"}
    del facts["digest"]  # of the costs, too
    return members, facts


@pytest.fixture
def erratic(monkeypatch, tmp_path):
    """Let a machine get ever busier (power 1) or idler (-1) while it measures, in a cache of its own."""
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))

    def start(power):
        now, ticks = [0.0], count(1)

        def clock():
            now[0] += 1e-3 * float(next(ticks)) ** power
            return now[0]

        monkeypatch.setattr(cost, "clock", clock)

    return start


def test_a_busy_machine_trains_the_same_model_file(erratic, tmp_path):
    erratic(1)
    train(surfaces(), pipeline()).save(tmp_path / "quiet.skops")
    erratic(-1)
    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        train(surfaces(), pipeline()).save(tmp_path / "busy.skops")
    finally:
        busy.kill()
        busy.wait()
    assert _told(tmp_path / "busy.skops") == _told(tmp_path / "quiet.skops")


def test_a_budget_in_milliseconds_is_of_the_machine_and_the_day_it_was_measured(erratic, tmp_path):
    made = []
    for power in (1, -1):
        erratic(power)
        made.append(train(surfaces(), pipeline(), classifier="lda", max_ms=500))
        made[-1].save(tmp_path / f"{power}.skops")
    assert made[0].manifest.pipeline["budget"].startswith("500 ms on ")
    assert _told(tmp_path / "1.skops") == _told(tmp_path / "-1.skops")
