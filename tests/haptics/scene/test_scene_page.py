"""The page of a scene renders the samples of `SceneRenderer`, limits the level, and responds to a pointer."""

import json
import re
import shutil
import subprocess
import time

import numpy as np
import pytest
from chromium import needs_chromium
from typer.testing import CliRunner

from texclass.cli import app
from texclass.haptics.exchange import save_texture
from texclass.haptics.scene import PlannedScene, SceneRenderer, scene_page, write_scene_page
from texclass.haptics.scene import render_kernels as kernels
from texclass.haptics.scene.pages import files
from texclass.haptics.scene.renderer import build_kernel_arrays
from texclass.haptics.textures import pack
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.recording import Phases, Recording, Tap
from texclass.vibration import TapModel

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed")
V, F, N = np.array([40.0, 80.0, 160.0]), np.array([0.5, 2.0]), 3000
RNG = np.random.default_rng(0)
LATTICE = GridModel((V, F), RNG.uniform(-0.9, 0.9, (3, 2, 6)), RNG.uniform(1, 9, (3, 2)), 20.0)
LINES = GridModel(
    (V, F), np.full((3, 2, 2), 0.9), np.ones((3, 2)), 4.0, np.array([120.0, 0]), np.array([0, 2.0])
)
BOTH = GridModel((V, F), RNG.uniform(0, 0.8, (3, 2, 4)), np.ones((3, 2)), 4.0, np.array([90.0]), np.zeros(1))
LONG = GridModel((V[:1], F[:1]), RNG.uniform(-0.4, 0.4, (1, 1, 400)), np.ones((1, 1)), 4.0)
MODELS = {"lattice": LATTICE, "lines": LINES, "both": BOTH, "order 400": LONG, "silence": GridModel.silence()}
TAP = TapModel(30.0, 90.0, 210.0)


def make_scene(models, fs=1000.0):
    indices = {name: i for i, name in enumerate(models)}
    return PlannedScene("all", fs, "m/s^2", (20.0, 450.0), 30.0, 1, indices, tuple(models.values()))


def renderer_noise(n, seed=5):
    """Return the first n noise samples of a renderer with one contact."""
    status = np.zeros((1, len(kernels.Status)), dtype=np.int64)
    initial = np.random.SeedSequence(seed).generate_state(1, np.uint64).view(np.int64)[0]
    status[0, kernels.Status.NOISE] = initial
    return [kernels.draw_noise(status, 0) for _ in range(n)]


def make_script(scene):
    """Return a path with jumps, rests and lifts, the noise of the renderer, and the samples it renders."""
    rng, names = np.random.default_rng(1), [*scene.model_indices, None]
    block = np.repeat(np.arange(N // 60), 60)
    speed, force = 10.0 ** rng.uniform(0.5, 3, N // 60), rng.choice([-1.0, 0.1, 1.0, 5.0], N // 60)
    speed[::7] = 0.0
    choice = rng.integers(0, len(names), N // 60)
    choice[: len(names)] = range(len(names))
    vx, vy, forces = 0.6 * speed[block], -0.8 * speed[block], force[block]
    surfaces = [names[i] for i in choice[block]]
    renderer = SceneRenderer(scene, n_contacts=1, seed=5)
    velocity = np.stack([vx, vy], axis=-1)[np.newaxis]
    samples = renderer.process(velocity, forces[np.newaxis], [surfaces])[0]
    model = [scene.model_indices.get(name, -1) for name in surfaces]
    bank, index = build_kernel_arrays(scene)
    script = {"vx": vx.tolist(), "vy": vy.tolist(), "force": forces.tolist(), "model": model}
    script["noise"] = renderer_noise(40 * N)
    data = {"bank": bank.tolist(), "index": index.ravel().tolist(), "script": script, "fs": scene.fs}
    return data, samples


def run_node(program, data=None):
    """Run a program after the kernels and the worklet with `data`, and return its result."""
    folder = files("texclass.haptics.scene").joinpath("web")
    head = "".join(folder.joinpath(f"{name}.js").read_text() for name in ("kernels", "worklet"))
    read = "const data = JSON.parse(require('fs').readFileSync(0, 'utf8'));"
    text = f"{head}{read} console.log(JSON.stringify((() => {{ {program} }})()));"
    process = subprocess.run(
        [NODE, "-e", text], input=json.dumps(data), capture_output=True, text=True, check=False
    )
    assert not process.returncode, process.stderr
    return json.loads(process.stdout)


RENDER_SCRIPT = """
let n = 0;
const { vx, vy, force, model, noise } = data.script;
const renderer = createRenderer(Float64Array.from(data.bank), data.index, 1, () => noise[n++]);
return vx.map((_, t) => { renderer.touch(0, model[t]); return renderer.step(0, vx[t], vy[t], force[t]); });"""


@needs_node
@pytest.mark.parametrize("fs", [1000.0, 3000.0])
@pytest.mark.parametrize("names", [*([name] for name in MODELS), list(MODELS)], ids=", ".join)
def test_javascript_and_python_render_the_same_samples_from_the_same_noise(names, fs):
    data, samples = make_script(make_scene({name: MODELS[name] for name in names}, fs))
    page_samples = np.array(run_node(RENDER_SCRIPT, data))
    assert np.abs(page_samples - samples).max() <= 1e-9 * np.abs(samples).max()
    assert np.abs(samples).max() > 0 or names == ["silence"]


@needs_node
def test_javascript_refuses_the_inputs_that_python_refuses_and_keeps_its_state():
    data, samples = make_script(make_scene({"lattice": LATTICE}))
    program = RENDER_SCRIPT.replace(
        "return renderer.step(",
        "const refused = [[1.4e154, 0, 1], [0, -1.01e9, 1], [NaN, 0, 1], [0, 0, Infinity]];"
        "if (!refused.every((motion) => Number.isNaN(renderer.step(0, ...motion)))) return 1e9;"
        "return renderer.step(",
    )
    assert np.abs(np.array(run_node(program, data)) - samples).max() <= 1e-9 * np.abs(samples).max()


@needs_node
def test_resampling_keeps_amplitude_and_frequency_of_a_tone_and_adds_no_image():
    program = """
    let t = 0;
    const next = createInterpolator(() => Math.sin(2 * Math.PI * 0.4 * t++), 1 / 48);
    return Array.from({ length: 48000 }, next);"""
    samples = np.array(run_node(program))[4800:]
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(samples.size))) / samples.size * 4
    hz = np.fft.rfftfreq(samples.size, 1 / 48000)
    assert hz[spectrum.argmax()] == pytest.approx(400, abs=1.2)
    assert spectrum.max() == pytest.approx(1, rel=0.01)
    assert spectrum[np.abs(hz - 400) > 10].max() < 1e-2


@needs_node
def test_a_tap_of_the_page_is_that_of_its_model():
    program = """
    const taps = createTaps(48000);
    taps.strike([[30, 90, 210, 0]], 0.2);
    return Array.from({ length: 5000 }, taps.next);"""
    samples = run_node(program)
    np.testing.assert_allclose(samples, TAP.synthesize(0.2, 5000, 48000.0), atol=1e-9)


@needs_node
def test_the_limiter_keeps_samples_below_half_of_full_scale_and_leaves_weak_ones_unchanged():
    program = """
    const limit = createLimiter(48000), unchanged = createLimiter(48000);
    const loud = Array.from({ length: 9000 }, (_, t) => limit(100 * randomNoise() * (t % 2000 < 900)));
    return [Math.max(...loud.map(Math.abs)), unchanged(0.3), unchanged(-0.1)];"""
    levels = run_node(program)
    assert levels == [pytest.approx(0.5), 0.3, -0.1]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "scene.html"
    return write_scene_page(path, make_scene(MODELS), taps={"lines": TAP})


def element_text(browser, element_id):
    return browser.run(f"document.getElementById('{element_id}').textContent")


def wait_for_text(browser, element_id, prefix):
    """Wait up to 3 s until the text of an element starts with a prefix; return whether it does."""
    end = time.monotonic() + 3.0
    while not (is_shown := element_text(browser, element_id).startswith(prefix)) and time.monotonic() < end:
        time.sleep(0.02)
    return is_shown


def send_mouse_event(browser, kind, x, y):
    browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)


@needs_chromium
def test_in_the_browser_the_worklet_renders_the_samples_of_the_renderer(browser, page):
    browser.open(page)
    data, samples = make_script(
        make_scene({name: MODELS[name] for name in ("lattice", "lines", "both", "silence")})
    )
    page_samples = browser.run(f"""(async () => {{
      const data = {json.dumps(data)}, context = new OfflineAudioContext(1, 48000 * 3.1, 48000);
      const code = ["kernels", "worklet"].map((id) => document.getElementById(id).textContent).join("");
      await context.audioWorklet.addModule("data:text/javascript," + encodeURIComponent(code));
      const options = {{ ...data, bank: Float64Array.from(data.bank), contacts: 1, fullScale: 1, gain: 1 }};
      const node = new AudioWorkletNode(context, "scene", {{ numberOfInputs: 0, numberOfOutputs: 2,
        outputChannelCount: [1, 1], processorOptions: options }});
      node.connect(context.destination);
      const samples = new Promise((resolve) => {{
        node.port.onmessage = (e) => e.data.samples && resolve(e.data.samples);
      }});
      await context.startRendering();
      return samples;
    }})()""")
    assert np.abs(np.array(page_samples) - samples).max() <= 1e-4 * np.abs(samples).max()


@needs_chromium
def test_a_stroke_is_audible_a_lift_is_silent_and_the_page_needs_no_network(browser, page):
    browser.events.clear()
    browser.open(page)
    x0, y0, width, height = browser.run(
        "(() => { const r = document.querySelector('.face').getBoundingClientRect();"
        "return [r.left, r.top, r.width, r.height]; })()"
    )
    send_mouse_event(browser, "mousePressed", x0 + 9, y0 + height / 2)
    for i in range(25):
        send_mouse_event(browser, "mouseMoved", x0 + 9 + i * (width - 20) / 50, y0 + height / 2)
        time.sleep(0.012)
    assert element_text(browser, "status").startswith("lattice: ")
    assert element_text(browser, "level") != "silent"
    send_mouse_event(browser, "mouseReleased", x0 + 9, y0 + height / 2)
    assert wait_for_text(browser, "level", "silent")
    assert not browser.noises(page)


@needs_chromium
def test_arrow_keys_stroke_at_the_speed_of_the_slider_and_enter_taps(browser, page):
    browser.open(page)
    browser.run("document.querySelectorAll('.tile')[1].focus(); document.getElementById('speed').value = 100")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight", windowsVirtualKeyCode=39)
    assert wait_for_text(browser, "status", "lines: 100 mm/s")
    browser.call("Input.dispatchKeyEvent", type="keyUp", key="ArrowRight", windowsVirtualKeyCode=39)
    browser.press("Enter", 13)
    assert wait_for_text(browser, "status", "lines: tapped")


@needs_chromium
def test_the_page_never_scrolls_horizontally(browser, page):
    for width in (360, 768, 1400):
        browser.open(page, width=width, scheme="dark")
        assert browser.run("document.documentElement.scrollWidth") <= width


def test_names_are_escaped_and_a_sampling_rate_above_44100_hz_is_rejected():
    hostile = "</script><script>alert(1)</script>"
    html = scene_page(make_scene({hostile: LATTICE}))
    assert hostile not in html
    with pytest.raises(ValueError, match="at most 44100"):
        scene_page(make_scene({"a": LATTICE}, fs=96_000.0))


def test_the_page_of_a_packed_texture_has_the_tap_of_the_recording(tmp_path):
    rng, fs = np.random.default_rng(0), 2000.0
    knock = 40.0 * np.exp(-90 * np.arange(400) / fs) * np.sin(2 * np.pi * 210 * np.arange(400) / fs)
    x = np.concatenate([np.zeros(600), knock, np.zeros(200), rng.standard_normal(4000)])
    recording = Recording(x, fs, "m/s^2", "knock", phases=Phases((Tap(550, 600, 1000),), (1200, x.size)))
    file = save_texture(pack(recording, 64), tmp_path / "knock.texture")
    result = CliRunner().invoke(app, ["texture", str(file), "--page", str(tmp_path / "scene.html")])
    assert result.exit_code == 0, result.output
    page = (tmp_path / "scene.html").read_text()
    assert "Taps were measured." in page
    ((amplitude, decay, hz, _), *_), _ = json.JSONDecoder().raw_decode(page.split('"tap": ')[1])
    assert (amplitude, decay, hz) == pytest.approx((400, 90, 210), rel=0.2)


def test_commands_write_a_small_page_of_a_planned_scene_with_measured_taps(tmp_path):
    planned = make_scene(MODELS).save(tmp_path / "all.texture")
    taps = save_texture(TapLibrary(("lines",), (TAP,)), tmp_path / "taps.texture")
    for options in (["scene", "page", planned, "--taps", taps, "-o"], ["texture", planned, "--page"]):
        result = CliRunner().invoke(app, [*map(str, options), str(tmp_path / "scene.html")])
        assert result.exit_code == 0, result.output
        assert (tmp_path / "scene.html").stat().st_size < 300_000
        assert ("Taps were measured, except 4" in (tmp_path / "scene.html").read_text()) == (
            "--taps" in options
        )
    result = CliRunner().invoke(app, ["scene", "page", str(planned), "-o", str(tmp_path / "scene.txt")])
    assert "Expected .html" in str(result.exception)


@needs_node
def test_the_filter_of_a_page_is_that_of_the_equalizer():
    taps, x = RNG.standard_normal(51), RNG.standard_normal(300)
    program = """
    let t = 0;
    const next = createFilter(() => data.x[t++], data.taps);
    return data.x.map(() => next());"""
    samples = run_node(program, {"taps": taps.tolist(), "x": x.tolist()})
    np.testing.assert_allclose(samples, np.convolve(x, taps)[:300], atol=1e-9)


def test_the_controls_of_a_page_are_at_the_nominal_speed_and_force_if_a_model_has_one_node():
    constant = GridModel(([5.0], [0.05]), np.full((1, 1, 2), 0.5), np.ones((1, 1)), 4.0)
    html = scene_page(make_scene({"noise": constant}))
    for name, low, value, high in (("speed", 50, 100, 200), ("force", 0.5, 1, 2)):
        control = re.search(rf'<input[^>]*id="{name}"[^>]*>', html)[0]
        limits = [float(re.search(rf'{key}="([^"]+)"', control)[1]) for key in ("min", "value", "max")]
        assert limits == [low, value, high]
