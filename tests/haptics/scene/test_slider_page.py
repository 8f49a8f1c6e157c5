"""The page with sliders renders the texture of `retouch`, whose perceptual scales follow the sliders."""

import json
import re

import numpy as np
import pytest
from chromium import needs_chromium
from scipy.stats import spearmanr
from test_scene_page import needs_node, renderer_noise, run_node, wait_for_text

from texclass.features import FeatureExtractor
from texclass.haptics import scale_values
from texclass.haptics.exchange import save_texture
from texclass.haptics.scene import PlannedScene, SceneRenderer, pages, write_slider_page
from texclass.haptics.scene import render_kernels as kernels
from texclass.haptics.scene.renderer import build_kernel_arrays
from texclass.haptics.textures import GridModel, pack, packing, retouch
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
    match = re.search(r'id="scene">(.*?)</script>', page.read_text(), re.S)
    return json.loads(match[1])


@pytest.fixture(scope="module")
def own_values(data):
    return {name: scale["value"] for name, scale in data["scales"].items()}


RENDER = """
const bank = new Float64Array(Uint8Array.from(atob(data.bank), (c) => c.charCodeAt(0)).buffer);
return data.sliderValues.map((sliderValues) => {
  const last = data.index.length / N_COLUMNS - 1;
  const { values, offset } = blendModels(bank, data.index, data.scales, sliderValues, last);
  bank.set(values, offset);
  let n = 0;
  const renderer = createRenderer(bank, data.index, 1, () => data.noise[n++ % data.noise.length]);
  renderer.touch(0, last);
  return data.speed.map((v) => renderer.step(0, v, 0, 1));
});"""


def render(data, slider_values, speed, noise):
    """Return the samples that the page renders, one row per set of slider values."""
    folder = pages.files("texclass.haptics.scene").joinpath("web")
    inputs = {"sliderValues": slider_values, "speed": list(speed), "noise": list(noise)}
    program = folder.joinpath("sliders.js").read_text() + RENDER
    return np.array(run_node(program, {key: data[key] for key in ("bank", "index", "scales")} | inputs))


def page_scene(data, model):
    """Return a scene with a model as the page stores it, padded to the order of all models."""
    order = data["index"][kernels.Column.ORDER]
    rows = np.pad(model.rows, ((0, 0), (0, 0), (0, order - model.order)))
    return PlannedScene(
        "slider", data["fs"], "m/s^2", (20.0, 450.0), 1e6, 1, {"wood": 0},
        (GridModel(model.axes, rows, model.power, model.peak),),
    )  # fmt: skip


def farthest_value(data, scale):
    """Return the value with a model on the page that is farthest from the texture's own."""
    slider = data["scales"][scale]
    return max(slider["values"], key=lambda value: abs(value - slider["value"]))


@needs_node
@pytest.mark.parametrize("scale", SPECTRAL)
def test_at_a_value_with_a_model_the_page_renders_the_retouched_texture(data, own_values, texture, scale):
    value = farthest_value(data, scale)
    scene = page_scene(data, retouch(texture, **{scale: value}).model)
    speed = np.repeat([80.0, 150.0, 20.0], 600)
    renderer = SceneRenderer(scene, n_contacts=1, seed=5)
    velocity = np.column_stack([speed, 0 * speed])[np.newaxis]
    samples = renderer.process(velocity, np.ones((1, speed.size)), [["wood"] * speed.size])[0]
    page_samples = render(data, [own_values | {scale: value}], speed, renderer_noise(4000))[0]
    assert np.abs(page_samples - samples).max() <= 1e-9 * np.abs(samples).max()


def rendered_scales(data, slider_values):
    """Return the spectral scales of the rendered vibration, one row per set of slider values."""
    t = np.arange(round(20 * data["fs"])) / data["fs"]
    speed = 110.0 * (0.55 + 0.45 * np.pi / 2 * np.abs(np.sin(np.pi * t)))
    noise = np.random.default_rng(1).uniform(-0.5, 0.5, (4, t.size + 1000)).sum(axis=0) * np.sqrt(3)
    strokes = [
        Recording(x, data["fs"], "m/s^2", str(i), phases=Phases(movement=(0, x.size)))
        for i, x in enumerate(render(data, slider_values, speed, noise))
    ]
    table = FeatureExtractor("scales").fit(strokes).extract(strokes).table
    return scale_values(table)[list(SPECTRAL)].to_numpy()


@needs_node
@pytest.mark.parametrize("scale", SPECTRAL)
def test_a_slider_changes_its_scale_and_no_other(data, own_values, scale):
    low, *_, high = data["scales"][scale]["values"]
    targets = np.linspace(max(low, own_values[scale] - 3), min(high, own_values[scale] + 3), 6)
    slider_values = [own_values, *(own_values | {scale: float(value)} for value in targets)]
    values = rendered_scales(data, slider_values)
    column = SPECTRAL.index(scale)
    assert spearmanr(targets, values[1:, column])[0] >= 0.9
    others = np.delete(np.abs(values[1:] - values[0]), column, axis=1)
    assert others.max() < 1.3


@needs_node
def test_several_sliders_at_once_change_their_scales(data, own_values):
    rng = np.random.default_rng(2)
    slider_values = [
        own_values | {name: own_values[name] + float(rng.uniform(-2.5, 2.5)) for name in SPECTRAL}
        for _ in range(16)
    ]
    values = rendered_scales(data, slider_values)
    for column, name in enumerate(SPECTRAL):
        assert spearmanr([row[name] for row in slider_values], values[:, column])[0] >= 0.7, name


@needs_node
def test_a_harder_tap_of_the_page_is_that_of_the_retouched_texture(data, own_values, texture):
    program = pages.files("texclass.haptics.scene").joinpath("web", "sliders.js").read_text()
    slider_values = own_values | {"hard": 10.0}
    inputs = {"tap": data["surfaces"][0]["tap"], "scales": data["scales"], "sliderValues": slider_values}
    program += "return blendTaps(data.tap, data.scales, data.sliderValues);"
    modes = np.array(run_node(program, inputs))
    tap = retouch(texture, hard=10.0).tap
    np.testing.assert_allclose(modes[:, 2], tap.frequency_hz, rtol=0.05)
    np.testing.assert_allclose(modes[:, 1], tap.decay_per_s, rtol=0.2)


RECORD_MESSAGES = """
const send = MessagePort.prototype.postMessage;
window.messages = [];
MessagePort.prototype.postMessage = function (message) {
  window.messages.push(message);
  return send.call(this, message);
};
"""


@needs_chromium
def test_in_the_browser_a_slider_changes_the_samples_and_the_command(
    browser, page, data, own_values, texture
):
    browser.events.clear()
    browser.open(page)
    browser.run(RECORD_MESSAGES)
    value = farthest_value(data, "rough")
    browser.run("document.getElementById('scale-rough').focus()")
    browser.press(*(("Home", 36) if value < own_values["rough"] else ("End", 35)))
    assert wait_for_text(browser, "status", "wood: ")  # a slider also strokes
    assert browser.run("document.getElementById('command').value") == (
        f"texclass convert 'my wood.texture' -o changed.texture --scale rough={value:g}"
    )
    values = browser.run("window.messages.filter((m) => m.values).map((m) => [...m.values])")[-1]
    bank, index = build_kernel_arrays(page_scene(data, retouch(texture, rough=value).model))
    np.testing.assert_allclose(values, bank[index[0, kernels.Column.SPEED_OFFSET] :], rtol=1e-9)
    browser.run("document.getElementById('reset').click()")
    assert "unchanged" in browser.run("document.getElementById('command').value")
    assert not browser.noises(page)


def test_a_slider_ends_where_interpolation_to_the_next_value_would_change_another_scale(
    texture, own_values, monkeypatch
):
    rough, regular = own_values["rough"], own_values["regular"]

    def halfway(one, other):
        return own_values | {"rough": rough - 1, "regular": regular - 1.4}

    monkeypatch.setattr(packing, "measure_scales", lambda texture: {"rough": rough, "regular": regular})
    monkeypatch.setattr(packing, "scales_halfway", halfway)
    monkeypatch.setattr(pages, "SLIDER_VALUES", (rough - 2,))
    assert '"values":' not in pages.slider_page(texture)


@needs_chromium
def test_the_page_never_scrolls_horizontally_and_every_control_has_a_label(browser, page):
    for width in (360, 768, 1400):
        browser.open(page, width=width, scheme="dark")
        assert browser.run("document.documentElement.scrollWidth") <= width
    unlabelled = "[...document.querySelectorAll('input, textarea')].filter((e) => !e.labels.length).length"
    assert browser.run(unlabelled) == 0


def test_the_command_writes_a_small_page_and_rejects_other_suffixes(
    command, texture, own_values, page, tmp_path, monkeypatch
):
    assert page.stat().st_size < 300_000
    source = save_texture(texture, tmp_path / "wood.texture")
    monkeypatch.setattr(pages, "SLIDER_VALUES", (7.0, 60.0))
    monkeypatch.setattr(packing, "measure_scales", lambda texture: {"rough": own_values["rough"]})
    code, _, err = command("texture", source, "--sliders", tmp_path / "wood.html")
    assert code == 0, err
    html = (tmp_path / "wood.html").read_text()
    assert "texclass convert wood.texture -o changed.texture" in html
    assert 'id="scale-rough"' in html
    assert 'max="60.0"' not in html  # cannot be reached
    code, _, err = command("texture", source, "--sliders", tmp_path / "wood.txt")
    assert code == 1
    assert "Expected .html" in err
