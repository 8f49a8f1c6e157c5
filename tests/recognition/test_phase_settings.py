"""Settings of segmentation reach every place that finds phases: a spacing of taps other than the default.

Taps come in pairs, 65 ms apart: by default (80 ms) a pair is one tap and its rebound.
"""

from dataclasses import replace

import numpy as np
import pytest

from texclass.cli import main
from texclass.evaluation import PipelineDefinition, cached_table, run_benchmark
from texclass.evaluation.pipeline import RowDefinition, Use
from texclass.features import FeatureExtractor, load_feature_set
from texclass.loaders import open_dataset
from texclass.phase_settings import PhaseSettings
from texclass.phases import find_phases
from texclass.recognition import OnlineRecogniser, load_model, train
from texclass.recording import Recording

FS = 10_000.0
PAIRS_S = (0.4, 0.9, 1.4)
CLOSE = {"tap_spacing_s": 0.03}
NUMBERS = {"as by default": 3, "close": 6}


def samples(hz, seed):
    t = np.arange(round(1.9 * FS)) / FS
    x = 0.02 * np.random.default_rng(seed).standard_normal(t.size)
    for at, strength in (*((at, 20.0) for at in PAIRS_S), *((at + 0.065, 12.0) for at in PAIRS_S)):
        after = np.maximum(t - at, 0.0)
        x += strength * np.exp(-after / 0.004) * np.sin(2 * np.pi * hz * after)
    return x


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("pairs")
    for name, hz in (("oak", 250.0), ("steel", 800.0)):
        (root / name).mkdir()
        for seed in range(5):
            np.savetxt(root / name / f"{name}_{seed}.txt", samples(hz * (1 + 0.02 * seed), seed))
    return root


def opened(folder, spacing):
    tap_spacing = CLOSE["tap_spacing_s"] if spacing == "close" else None
    return open_dataset(folder, fs=FS, unit="m/s^2", tap_spacing=tap_spacing)


def pipeline(**changes):
    return PipelineDefinition(
        name="taps",
        features=load_feature_set("texclass").restricted_to(["damping", "tap_strength"]),
        steps=(Use(use="sklearn.preprocessing.StandardScaler"),),
        classifiers={"bayes": Use(use="sklearn.naive_bayes.GaussianNB")},
        rows=(RowDefinition(name="Taps", features=("damping", "tap_strength")),),
        seed=0,
        **changes,
    )


def n_taps(recording):
    return len(find_phases(recording).taps)


def taps_heard(model):
    updates = OnlineRecogniser(model).push(samples(250.0, 9))
    return sum(getattr(update, "kind", "") == "tap" for update in updates)


@pytest.mark.parametrize("spacing", NUMBERS)
def test_the_option_reaches_extraction_benchmark_model_file_prediction_and_stream(spacing, folder, tmp_path):
    dataset, expected = opened(folder, spacing), NUMBERS[spacing]
    assert n_taps(dataset[0]) == expected
    table = cached_table(dataset, pipeline().features, n_jobs=1)
    assert {phases.n_taps for phases in table.phases} == {expected}
    assert taps_benchmarked(dataset, pipeline()) == expected
    train(dataset, pipeline(), n_jobs=1).save(tmp_path / "taps.skops")
    model = load_model(tmp_path / "taps.skops")
    assert model.manifest.phase_settings == dataset[0].phase_settings
    unlabelled = Recording(samples(250.0, 7), FS, "m/s^2", channels=dataset[0].channels)
    features = FeatureExtractor(pipeline().features).fit([dataset[0]])
    stated = unlabelled.with_(phase_settings=dataset[0].phase_settings)
    np.testing.assert_allclose(
        model.compute(model.cut(unlabelled)[0]).values, features.transform([stated])[0]
    )
    assert taps_heard(model) == expected


def test_the_option_of_the_command_line_is_passed_on(folder, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [
        "texclass", "inspect", str(folder / "oak" / "oak_0.txt"), "--fs", "10000", "--unit", "m/s^2",
        "--tap-spacing", "0.03", "-o", "picture.png",
    ])  # fmt: skip
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert "6 taps" in capsys.readouterr().out


def test_card_and_pipeline_state_settings_and_the_most_specific_counts(folder, tmp_path):
    card = tmp_path / "pairs.toml"
    files = r"files = '(?P<surface>\w+)/\w+\.txt'"
    card.write_text(f"fs_hz = 10000\nunit = 'm/s^2'\nfolder = '{folder}'\n{files}\n")
    assert n_taps(open_dataset(card)[0]) == 3
    plain = open_dataset(card)
    card.write_text(card.read_text() + "[phase_settings]\ntap_spacing_s = 0.03\n")
    close = open_dataset(card)
    assert n_taps(close[0]) == 6
    assert n_taps(open_dataset(card, tap_spacing=0.08)[0]) == 3
    assert close.input_hash != plain.input_hash
    by_pipeline = PhaseSettings(tap_spacing_s=0.03).changes
    assert n_taps(plain.with_phase_settings(by_pipeline, override=False)[0]) == 6
    wide = {"tap_spacing_s": 0.2}
    assert n_taps(close.with_phase_settings(wide, override=False)[0]) == 6
    assert n_taps(close.with_phase_settings(wide)[0]) == 3


def taps_benchmarked(dataset, stated):
    result = run_benchmark(dataset, stated, protocol="recording", n_folds=2, n_jobs=1)
    return len(result.data["example"]["taps"])


def taps_heard_by_a_model(dataset, stated):
    return taps_heard(train(dataset, stated, n_jobs=1))


@pytest.mark.parametrize("count", [taps_benchmarked, taps_heard_by_a_model])
def test_settings_of_a_pipeline_reach_benchmark_and_model(folder, count):
    stated = pipeline(phase_settings=PhaseSettings(**CLOSE))
    assert count(opened(folder, "as by default"), stated) == 6


@pytest.mark.parametrize("stated", [{"tap_spacing_s": 0.0}, {"contents": "strokes"}])
def test_impossible_settings_are_refused(stated):
    with pytest.raises(ValueError, match=next(iter(stated))):
        replace(PhaseSettings(), **stated)
