"""Chapter of okamura2001 on taps, and its simulated people."""

import json

import matplotlib as mpl
import numpy as np
import okamura2001
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from numpy.testing import assert_allclose, assert_array_equal
from okamura2001_people import (
    DESIGN,
    EFFECTS,
    FACTORS,
    MOST_SENSITIVE,
    analyse,
    are_all_correct,
    confusion,
    find_noise,
    most_sensitive,
    normalized_ratings,
    runs,
    simulate_answers,
    simulate_ratings,
)
from okamura2001_taps import MATERIALS, TABLE_II
from scipy import stats

from texclass.reporting.figure_style import STYLE, WIDTH
from texclass.vibration import TapModel


def test_the_chapter_reports_what_is_simulated_and_what_is_skipped(tmp_path):
    paths = okamura2001.main(tmp_path, seed=1, small=True)
    assert all(path.stat().st_size > 0 for path in paths)
    text = (tmp_path / "okamura2001.md").read_text(encoding="utf-8")
    assert "Everything below is simulated" in text
    assert "Skipped: the recordings are not on this machine" in text
    numbers = json.loads((tmp_path / "okamura2001.json").read_text(encoding="utf-8"))
    assert (numbers["seed"], numbers["input_hash"]) == (1, {})
    for by_surface in numbers["recovery_percent"].values():
        assert all(max(one["largest"]) < 5 for one in by_surface.values())
    for one in numbers["recovery_as_published_percent"].values():  # B within 8 % for any noise
        assert np.all(np.array(one["largest"]) < [15, 8, 10])
    assert numbers["identification"]["correct"] == pytest.approx(35, abs=6)


def test_figures_show_the_velocity_of_the_height_and_complete_labels():
    libraries = {"ours": okamura2001.TABLE_I, "published": TABLE_II, "rule": TABLE_II}
    ratings = {m: simulate_ratings("decay", np.random.default_rng(0)) for m in MATERIALS}
    pictures = (
        okamura2001.draw_wall,
        lambda width: okamura2001.draw_device(width, libraries),
        lambda width: okamura2001.draw_ratings(width, ratings),
    )
    for draw in pictures:
        with mpl.rc_context(STYLE):
            figure = draw(WIDTH)
            FigureCanvasAgg(figure).draw()
            texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
            assert not any("$" in text.get_text() for text in texts)
            for label in (label for axes in figure.axes for label in (axes.xaxis.label, axes.yaxis.label)):
                box = label.get_window_extent()
                assert min(*box.min, *(figure.bbox.max - box.max)) >= 0
    above, middle = (okamura2001.draw_wall(WIDTH).axes[i].lines[0] for i in (0, 3))
    t, height = above.get_data()
    assert_allclose(middle.get_ydata(), 1e3 * np.gradient(height, t), atol=1e-6)


def test_the_design_is_balanced_and_has_each_combination_once():
    assert len(np.unique(DESIGN, axis=0)) == 8
    assert_array_equal(DESIGN.T @ DESIGN, 8 * np.eye(3))
    low, high = TapModel(1.0, 2.0, 3.0), TapModel(4.0, 5.0, 6.0)
    models = runs(low, high)
    assert (models[0], models[7]) == (low, high)
    assert models[1] == TapModel(4.0, 2.0, 3.0)


def test_the_analysis_of_variance_equals_that_of_the_linear_model():
    single = analyse(np.tile(5 + 3 * DESIGN[:, 1], (4, 1)))  # the effect of one factor
    assert most_sensitive(single) == "decay"
    assert_allclose(single["effect"], [0, 2, 0, 0, 0, 0, 0], atol=1e-12)
    ratings = simulate_ratings("frequency", np.random.default_rng(1), n_users=6)
    y = normalized_ratings(3 * ratings + 7)
    assert_allclose([y.mean(axis=1), y.std(axis=1)], [[0] * 6, [1] * 6], atol=1e-12)
    assert_allclose(normalized_ratings(ratings), y, atol=1e-12)
    result = analyse(y)
    A, B, w = DESIGN.T
    full = np.tile(np.stack([np.ones(8), A, B, w, A * B, A * w, B * w, A * B * w], axis=1), (6, 1))
    users = np.kron(np.eye(6), np.ones((8, 1)))[:, 1:]

    def residual_of(x):
        x = np.hstack([x, users])
        return np.sum((y.ravel() - x @ np.linalg.lstsq(x, y.ravel(), rcond=None)[0]) ** 2)

    freedom = 48 - 8 - 5
    for i, name in enumerate(EFFECTS, start=1):
        residual = residual_of(full)
        f_value = (residual_of(np.delete(full, i, axis=1)) - residual) / (residual / freedom)
        assert_allclose(result.loc[name, "F"], f_value, rtol=1e-8)
        assert_allclose(result.loc[name, "p"], stats.f.sf(f_value, 1, freedom), rtol=1e-6)


def test_the_factor_with_the_largest_effect_is_recovered():
    for factor in MOST_SENSITIVE.values():
        for seed in range(20):
            analysis = analyse(simulate_ratings(factor, np.random.default_rng(seed)))
            assert most_sensitive(analysis) == factor
            assert analysis.loc[factor, "p"] < 0.01


def test_ratings_without_preference_are_rejected_at_the_nominal_level():
    rng = np.random.default_rng(0)
    p = [analyse(rng.standard_normal((10, 8))).loc[list(FACTORS), "p"] for _ in range(300)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.08


def test_invalid_and_constant_ratings_are_refused():
    for ratings in (np.ones((3, 8)), np.zeros((0, 8)), np.arange(8.0), np.arange(8.0)[None], np.eye(7)):
        with pytest.raises(ValueError, match="must"):
            analyse(ratings)


def test_users_are_correct_without_noise_and_at_chance_level_with_large_noise():
    correct = simulate_answers(TABLE_II, 0.0, np.random.default_rng(0))
    assert_array_equal(confusion(correct), 42 * np.eye(3))
    assert are_all_correct(correct).all()
    guesses = simulate_answers(TABLE_II, 1e6, np.random.default_rng(0), n_experiments=6000)
    assert_allclose(are_all_correct(guesses).mean(), 1 / 6, atol=0.02)
    answers = simulate_answers(TABLE_II, 1.0, np.random.default_rng(0), n_experiments=100)
    table = confusion(answers)
    assert_array_equal(table.sum(axis=0), [100] * 3)
    assert_array_equal(table.sum(axis=1), [100] * 3)
    assert are_all_correct(answers).sum() <= table.trace() / 3
    swapped = np.array([[0, 1, 2], [1, 0, 2]])
    assert are_all_correct(swapped).tolist() == [True, False]
    assert_array_equal(confusion(swapped), [[1, 1, 0], [1, 1, 0], [0, 0, 2]])


def test_the_noise_for_a_fraction_of_correct_experiments_is_determined():
    noise = find_noise(TABLE_II, 0.8, n_experiments=4000)
    answers = simulate_answers(TABLE_II, noise, np.random.default_rng(9), n_experiments=4000)
    assert_allclose(are_all_correct(answers).mean(), 0.8, atol=0.03)
    with pytest.raises(ValueError, match="chance level"):
        find_noise(TABLE_II, 0.1)


def test_velocity_errors_only_change_the_slope():
    recovery = okamura2001.recover(0, n_seeds=1).set_index(["material", "velocity"])
    for m in MATERIALS:
        small, large = recovery.loc[(m, 0.02)], recovery.loc[(m, 0.06)]
        assert_array_equal(small[["B", "w"]], large[["B", "w"]])
        assert small["A"] != large["A"]


def test_real_taps_are_fitted_in_samples_and_silent_ones_are_skipped():
    impulses = [TapModel(a, 0.02, 0.05).synthesize(1.0, 190, 1.0) for a in (50, -80)]
    taps = [np.concatenate([np.zeros(10), tap]) for tap in impulses]
    *fits, skipped = okamura2001.fit_each([*taps, np.zeros(50)])
    assert skipped is None
    for one in fits:
        assert_allclose(one.model.decay_per_s, 0.02, rtol=1e-3)
        assert_allclose(one.model.frequency_hz, 0.05, rtol=1e-3)
        assert_allclose(one.explained_energy, 1, atol=1e-4)
