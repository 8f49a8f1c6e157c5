"""The sliders of the page play the texture that `retouch` makes, and it feels as they say."""

import json
import re

import numpy as np
import pytest
from chromium import needs_chromium
from scipy.stats import spearmanr
from test_feel_page import comes, drawn, needs_node, node

from texclass.features import FeatureExtractor
from texclass.haptics import scale_values
from texclass.haptics.exchange import save_texture
from texclass.haptics.scene import PlannedScene, SceneRenderer, pages, write_slider_page
from texclass.haptics.scene import render_kernels as kernels
from texclass.haptics.scene.renderer import packed
from texclass.haptics.textures import GridModel, pack, retouch
from texclass.recording import Phases, Recording
from texclass.simulate import operator_catalogue, record_freehand, surface_catalogue

SPECTRAL = ("rough", "bumpy", "fine", "regular")


@pytest.fixture(scope="module")
def texture():
    surface, operator = surface_catalogue(6, seed=6)[2], operator_catalogue(2, seed=6)[1]
    return pack(record_freehand(surface, operator, duration_s=6.0, fs=1000, seed=30), 128, name="wood")


@pytest.fixture(scope="module")
def page(texture, tmp_path_factory):
    return write_slider_page(tmp_path_factory.mktemp("page") / "w.html", texture, file="my wood.texture")


@pytest.fixture(scope="module")
def data(page):
    found = re.search(r'id="scene">(.*?)</script>', page.read_text(), re.S)
    return json.loads(found[1])


@pytest.fixture(scope="module")
def own(data):
    return {name: scale["value"] for name, scale in data["scales"].items()}


PLAY = """
const bank = new Float64Array(Uint8Array.from(atob(given.bank), (c) => c.charCodeAt(0)).buffer);
return given.chosen.map((chosen) => {
  const last = given.index.length / N_INDEX - 1;
  const { part, at } = blended(bank, given.index, given.scales, chosen, last);
  bank.set(part, at);
  let drawn = 0;
  const player = createRenderer(bank, given.index, 1, () => given.noise[drawn++ % given.noise.length]);
  player.touch(0, last);
  return given.speed.map((v) => player.step(0, v, 0, 1));
});"""


def play(data, chosen, speed, noise):
    """Return what the page plays under its sliders, one row for each choice."""
    folder = pages.files("texclass.haptics.scene").joinpath("feel")
    given = {"chosen": chosen, "speed": list(speed), "noise": list(noise)}
    program = folder.joinpath("sliders.js").read_text() + PLAY
    return np.array(node(program, {key: data[key] for key in ("bank", "index", "scales")} | given))


def stored(data, model):
    """Return a model as the page keeps it, of the order that all of them have."""
    order = data["index"][kernels.Column.ORDER]
    rows = np.pad(model.rows, ((0, 0), (0, 0), (0, order - model.order)))
    return PlannedScene(
        "one", data["fs"], "m/s^2", (20.0, 450.0), 1e6, 1, {"wood": 0},
        (GridModel(model.axes, rows, model.power, model.peak),),
    )  # fmt: skip


def a_held_value(data, scale):
    """Return the value farthest from the texture's own at which the page holds a model."""
    found = data["scales"][scale]
    return max(found["values"], key=lambda value: abs(value - found["value"]))


@needs_node
@pytest.mark.parametrize("scale", SPECTRAL)
def test_at_a_value_that_the_page_holds_it_plays_the_retouched_texture(data, own, texture, scale):
    value = a_held_value(data, scale)
    scene = stored(data, retouch(texture, **{scale: value}).model)
    speed = np.repeat([80.0, 150.0, 20.0], 600)
    renderer = SceneRenderer(scene, n_contacts=1, seed=5)
    velocity = np.column_stack([speed, 0 * speed])[np.newaxis]
    played = renderer.process(velocity, np.ones((1, speed.size)), [["wood"] * speed.size])[0]
    found = play(data, [own | {scale: value}], speed, drawn(4000))[0]
    assert np.abs(found - played).max() <= 1e-9 * np.abs(played).max()


def felt(data, chosen):
    """Return how what the page plays feels, on the scales of the spectrum, one row for each choice."""
    t = np.arange(round(20 * data["fs"])) / data["fs"]
    speed = 110.0 * (0.55 + 0.45 * np.pi / 2 * np.abs(np.sin(np.pi * t)))
    noise = np.random.default_rng(1).uniform(-0.5, 0.5, (4, t.size + 1000)).sum(axis=0) * np.sqrt(3)
    strokes = [
        Recording(x, data["fs"], "m/s^2", str(i), phases=Phases(movement=(0, x.size)))
        for i, x in enumerate(play(data, chosen, speed, noise))
    ]
    table = FeatureExtractor("scales").fit(strokes).extract(strokes).table
    return scale_values(table)[list(SPECTRAL)].to_numpy()


@needs_node
@pytest.mark.parametrize("scale", SPECTRAL)
def test_what_is_played_feels_as_a_slider_says_and_else_as_before(data, own, scale):
    low, *_, high = data["scales"][scale]["values"]
    asked = np.linspace(max(low, own[scale] - 3), min(high, own[scale] + 3), 6)
    values = felt(data, [own, *(own | {scale: float(value)} for value in asked)])
    at = SPECTRAL.index(scale)
    assert spearmanr(asked, values[1:, at])[0] >= 0.9
    others = np.delete(np.abs(values[1:] - values[0]), at, axis=1)
    assert others.max() < 1.0


@needs_node
def test_several_sliders_at_once_feel_as_they_say(data, own):
    rng = np.random.default_rng(2)
    chosen = [own | {name: own[name] + float(rng.uniform(-1.5, 1.5)) for name in SPECTRAL} for _ in range(16)]
    values = felt(data, chosen)
    for at, name in enumerate(SPECTRAL):
        assert spearmanr([one[name] for one in chosen], values[:, at])[0] >= 0.8, name


@needs_node
def test_a_harder_tap_of_the_page_is_that_of_the_retouched_texture(data, own, texture):
    program = pages.files("texclass.haptics.scene").joinpath("feel", "sliders.js").read_text()
    given = {"tap": data["surfaces"][0]["tap"], "scales": data["scales"], "chosen": own | {"hard": 10.0}}
    found = np.array(node(f"{program} return blendedTap(given.tap, given.scales, given.chosen);", given))
    tap = retouch(texture, hard=10.0).tap
    np.testing.assert_allclose(found[:, 2], tap.frequency_hz, rtol=0.05)
    np.testing.assert_allclose(found[:, 1], tap.decay_per_s, rtol=0.2)


SENT = """
const send = MessagePort.prototype.postMessage;
window.sent = [];
MessagePort.prototype.postMessage = function (message) {
  window.sent.push(message);
  return send.call(this, message);
};
"""


@needs_chromium
def test_in_the_browser_a_slider_reaches_the_samples_and_the_command(browser, page, data, own, texture):
    browser.events.clear()
    browser.open(page)
    browser.run(SENT)
    value = a_held_value(data, "rough")
    browser.run("document.getElementById('scale-rough').focus()")
    browser.press(*(("Home", 36) if value < own["rough"] else ("End", 35)))
    assert comes(browser, "said", "wood: ")  # strokes by itself
    assert browser.run("document.getElementById('command').value") == (
        f"texclass convert 'my wood.texture' -o changed.texture --scale rough={value:g}"
    )
    sent = browser.run("window.sent.filter((m) => m.part).map((m) => [...m.part])")[-1]
    bank, index = packed(stored(data, retouch(texture, rough=value).model))
    np.testing.assert_allclose(sent, bank[index[0, kernels.Column.AT_SPEEDS] :], rtol=1e-9)
    browser.run("document.getElementById('reset').click()")
    assert "as it was" in browser.run("document.getElementById('command').value")
    assert not browser.noises(page)


def test_a_slider_ends_where_the_blend_to_the_next_value_would_change_another_scale(
    texture, own, monkeypatch
):
    def halfway(one, other):
        return own | {"rough": own["rough"] - 1, "regular": own["regular"] - 1.4}

    monkeypatch.setattr(
        pages, "measure_scales", lambda texture: {"rough": own["rough"], "regular": own["regular"]}
    )
    monkeypatch.setattr(pages, "scales_halfway", halfway)
    monkeypatch.setattr(pages, "VALUES", (own["rough"] - 2,))
    assert '"values"' not in pages.slider_page(texture)


@needs_chromium
def test_the_page_never_scrolls_sideways_and_every_control_has_a_name(browser, page):
    for width in (360, 768, 1400):
        browser.open(page, width=width, scheme="dark")
        assert browser.run("document.documentElement.scrollWidth") <= width
    unnamed = "[...document.querySelectorAll('input, textarea')].filter((e) => !e.labels.length).length"
    assert browser.run(unnamed) == 0


def test_the_command_writes_a_small_page_and_refuses_what_is_no_texture(
    command, texture, own, page, tmp_path, monkeypatch
):
    assert page.stat().st_size < 300_000
    source = save_texture(texture, tmp_path / "wood.texture")
    monkeypatch.setattr(pages, "VALUES", (7.0, 60.0))
    monkeypatch.setattr(pages, "measure_scales", lambda texture: {"rough": own["rough"]})
    code, _, err = command("texture", source, "--sliders", tmp_path / "wood.html")
    assert code == 0, err
    written = (tmp_path / "wood.html").read_text()
    assert "texclass convert wood.texture -o changed.texture" in written
    assert 'id="scale-rough"' in written
    assert 'max="60.0"' not in written  # out of reach
    code, _, err = command("texture", source, "--sliders", tmp_path / "wood.txt")
    assert code == 1
    assert "Expected .html" in err
