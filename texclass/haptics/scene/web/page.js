"use strict";
// Main script. Pointers, keys and gamepads set speed and force of the contacts in the worklet. The worklet returns the
// vibration, which drives the plots, the meter, the messages and the vibration motors.
(() => {
  const MM_PER_PX = 25.4 / 96, REST_MS = 60, N_POINTERS = 4, KEYS = N_POINTERS, PLOT_S = 0.15;
  const element = (id) => document.getElementById(id);
  const scene = JSON.parse(element("scene").textContent);
  const bank = new Float64Array(Uint8Array.from(atob(scene.bank), (c) => c.charCodeAt(0)).buffer);
  const tiles = [...document.querySelectorAll(".tile")];
  const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const showMessage = (text) => { if (element("status").textContent !== text) element("status").textContent = text; };
  const volume = () => 10 ** (element("volume").value / 20);
  const contacts = Array.from({ length: N_POINTERS + 1 }, () => null);  // {tile, x, y, events, force, pointer}
  let paintTimer = 0, slideEnd = 0, context = null, node = null, analyser = null, initialization = null, firstTouch = 0;

  // Sound --------------------------------------------------------------------------------------------------

  async function initialize() {
    context = new AudioContext({ latencyHint: "interactive" });
    const text = element("kernels").textContent + element("worklet").textContent;
    const module = `data:text/javascript,${encodeURIComponent(text)}`;  // Chromium refuses a Blob in a local file
    await context.audioWorklet.addModule(module);
    const { index, fs, full_scale: fullScale, equalizer } = scene;
    const options = { bank, index, fs, fullScale, equalizer, gain: volume(), contacts: contacts.length };
    node = new AudioWorkletNode(context, "scene",
      { numberOfInputs: 0, numberOfOutputs: 2, outputChannelCount: [1, 1], processorOptions: options });
    analyser = new AnalyserNode(context, { fftSize: 8192, smoothingTimeConstant: 0.6 });
    node.connect(context.destination, 0);
    node.connect(analyser, 1);
    node.port.onmessage = ({ data }) => {
      const { contextTime, performanceTime } = context.getOutputTimestamp();
      const latency = performanceTime + 1000 * (data.startTime - contextTime) - firstTouch;
      document.body.dataset.firstSoundMs = latency.toFixed(1);
    };
    contacts.forEach((contact, i) => { if (contact) send(i); });
  }

  async function start() {  // browsers allow audio only after a user gesture
    firstTouch ||= performance.now();
    await initialization;
    if (context?.state === "suspended") await context.resume();
  }

  function send(i, vx = 0, vy = 0) {
    const contact = contacts[i];
    const model = contact ? scene.surfaces[contact.tile.dataset.index].model : -1;
    node?.port.postMessage({ contact: i, model, vx, vy, force: contact?.force ?? 0 });
    if (contact) Object.assign(contact, { vx, vy, speed: Math.hypot(vx, vy) });
  }

  async function tap(tile, force) {
    const { name, tap: modes } = scene.surfaces[tile.dataset.index];
    start();
    if (modes) node?.port.postMessage({ tap: modes, velocity: 0.1 * force });
    tile.classList.remove("tapped");
    void tile.offsetWidth;  // restarts the animation
    tile.classList.add("tapped");
    showMessage(modes ? `${name}: tapped` : `${name}: no tap available`);
  }

  // Contacts -----------------------------------------------------------------------------------------------

  const sliderForce = () => Number(element("force").value);
  const forceOf = (event) => event.pointerType !== "mouse" && event.pressure > 0 && ![0.5, 1].includes(event.pressure)
    ? scene.forces[0] + event.pressure * (scene.forces[1] - scene.forces[0]) : sliderForce();

  function moveDot(i) {
    const dot = element(`dot-${i}`), contact = contacts[i];
    dot.hidden = !contact;
    if (!contact) return;
    contact.tile.querySelector(".face").append(dot);
    dot.style.translate = `${contact.x}px ${contact.y}px`;
  }

  function locate(event) {
    const tile = document.elementFromPoint(event.clientX, event.clientY)?.closest(".tile");
    if (!tile) return null;
    const box = tile.querySelector(".face").getBoundingClientRect();
    return { tile, x: event.clientX - box.left, y: event.clientY - box.top, events: [], pointer: event.pointerId };
  }

  const contactOf = (event) => contacts.findIndex((contact) => contact && contact.pointer === event.pointerId);

  function down(event) {
    const free = contacts.slice(0, N_POINTERS).indexOf(null), contact = locate(event);
    if (!contact || free < 0 || event.button > 0) return;
    contacts[free] = { ...contact, force: forceOf(event) };
    tap(contact.tile, contacts[free].force);
    send(free);
    moveDot(free);
  }

  function move(event) {
    const i = contactOf(event);
    if (i < 0) return;
    const position = locate(event);
    if (!position) return lift(event);
    const events = [...contacts[i].events], coalesced = event.getCoalescedEvents?.() ?? [];
    for (const e of coalesced.length ? coalesced : [event]) events.push([e.timeStamp, e.clientX, e.clientY]);
    while (events.length > 2 && events.at(-1)[0] - events[0][0] > 40) events.shift();  // mean speed over 40 ms
    const [t0, x0, y0] = events[0], [t1, x1, y1] = events.at(-1), seconds = Math.max(t1 - t0, 4) / 1000;
    contacts[i] = { ...position, events, force: forceOf(event), movedAt: performance.now() };
    send(i, MM_PER_PX * (x1 - x0) / seconds, MM_PER_PX * (y1 - y0) / seconds);
    moveDot(i);
  }

  function lift(event) {
    const i = contactOf(event);
    if (i < 0) return;
    contacts[i] = null;
    send(i);
    moveDot(i);
  }

  element("tiles").addEventListener("pointerdown", down);
  addEventListener("pointermove", move);
  for (const kind of ["pointerup", "pointercancel"]) addEventListener(kind, lift);

  // Keys and gamepads: one contact on the tile that has the focus -------------------------------------------

  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const keys = new Set();
  let steeredAt = performance.now(), wasButtonPressed = false;

  addEventListener("keydown", (event) => {
    const tile = event.target.closest?.(".tile");
    if (!tile || event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key in ARROWS) {
      keys.add(event.key);
      start();
    } else if (["Enter", " "].includes(event.key)) {
      if (!event.repeat) tap(tile, sliderForce());
    } else return;
    event.preventDefault();
  });
  addEventListener("keyup", (event) => keys.delete(event.key));
  addEventListener("blur", () => {
    keys.clear();
    contacts.forEach((_, i) => { contacts[i] = null; send(i); moveDot(i); });
  });

  function steer() {
    const gamepad = [...(navigator.getGamepads?.() ?? [])].find((device) => device?.connected);
    const arrows = [...keys].reduce(([x, y], key) => [x + ARROWS[key][0], y + ARROWS[key][1]], [0, 0]);
    const length = Math.hypot(...arrows) || 1, stick = gamepad?.axes.slice(0, 2) ?? [0, 0];
    const isStickUsed = Math.hypot(...stick) > 0.15;
    const isSliding = performance.now() < slideEnd, focused = document.activeElement?.closest?.(".tile");
    const direction = isStickUsed ? stick : isSliding && !focused ? [1, 0] : [arrows[0] / length, arrows[1] / length];
    const isButtonPressed = Boolean(gamepad?.buttons[0]?.pressed), tile = focused ?? (isSliding ? tiles[0] : null);
    const trigger = gamepad?.buttons[7]?.value || 0;
    if (tile && isButtonPressed && !wasButtonPressed) tap(tile, sliderForce());
    wasButtonPressed = isButtonPressed;
    const seconds = Math.min(performance.now() - steeredAt, 100) / 1000, previous = contacts[KEYS];
    steeredAt = performance.now();
    if (!tile || !(direction[0] || direction[1])) {
      if (previous) { contacts[KEYS] = null; send(KEYS); moveDot(KEYS); }
      return gamepad;
    }
    const face = tile.querySelector(".face"), speed = Number(element("speed").value);
    const begin = previous?.tile === tile ? previous : { x: face.clientWidth / 2, y: face.clientHeight / 2 };
    const wrap = (x, size) => ((x % size) + size) % size;
    const force = trigger ? scene.forces[0] + trigger * (scene.forces[1] - scene.forces[0]) : sliderForce();
    contacts[KEYS] = {
      tile, force, x: wrap(begin.x + direction[0] * speed * seconds / MM_PER_PX, face.clientWidth),
      y: wrap(begin.y + direction[1] * speed * seconds / MM_PER_PX, face.clientHeight),
    };
    send(KEYS, direction[0] * speed, direction[1] * speed);
    moveDot(KEYS);
    return gamepad;
  }

  // Vibration: plots, meter and motors ----------------------------------------------------------------------

  const LOUDNESS = [[-60, "silent"], [-42, "faint"], [-30, "soft"], [-18, "clear"], [-6, "strong"], [99, "loud"]];
  const wave = new Float32Array(8192), bands = new Float32Array(4096);
  let plotTime = 0, vibrationTime = 0;

  function plot(canvas, values, begin, end, scale) {
    const pen = canvas.getContext("2d"), { width, height } = canvas, style = getComputedStyle(canvas);
    pen.clearRect(0, 0, width, height);
    pen.strokeStyle = style.color;
    pen.lineWidth = 2;
    pen.beginPath();
    for (let i = begin; i < end; i++) {
      pen.lineTo((i - begin) / (end - begin - 1) * width, height * (1 - scale(values[i])));
    }
    pen.stroke();
  }

  function showVibration(gamepad) {
    if (!analyser) return;
    analyser.getFloatTimeDomainData(wave);
    const rms = Math.sqrt(wave.reduce((sum, x) => sum + x * x, 0) / wave.length);
    const level = Math.max(20 * Math.log10(rms * volume()), -99), now = performance.now();
    if (now - vibrationTime > 60) {  // the API sets the duration of motor pulses, not the waveform
      vibrationTime = now;
      const strength = Math.min(1, rms);
      if (strength > 0.02) {
        const effect = { duration: 80, weakMagnitude: strength, strongMagnitude: strength / 2 };
        gamepad?.vibrationActuator?.playEffect?.("dual-rumble", effect)?.catch(() => {});
        if (element("vibrate").checked && contacts.some(Boolean)) navigator.vibrate?.(Math.round(10 + 50 * strength));
      }
    }
    if (now - plotTime < (reducedMotion.matches ? 500 : 33)) return;
    plotTime = now;
    const isLimited = Math.max(...wave.map(Math.abs)) * volume() > CEILING;
    element("meter").value = Math.max(level, -60);
    element("level").textContent = `${LOUDNESS.find(([limit]) => level < limit)[1]}${isLimited ? ", limited" : ""}`;
    element("rms").textContent = `${(rms * scene.full_scale).toPrecision(2)} ${scene.unit}`;
    const n = Math.round(PLOT_S * context.sampleRate), step = context.sampleRate / 8192;
    plot(element("wave"), wave, wave.length - n, wave.length, (x) => 0.5 + x / 6);
    analyser.getFloatFrequencyData(bands);
    const edge = Math.min(scene.fs / 2, context.sampleRate / 2);
    plot(element("spectrum"), bands, 0, Math.round(edge / step), (db) => Math.max(0, Math.min(1, 1 + db / 90)));
    const contact = contacts.find(Boolean);
    if (contact) {
      const { name } = scene.surfaces[contact.tile.dataset.index];
      showMessage(`${name}: ${Math.round(contact.speed)} mm/s, ${contact.force.toFixed(1)} N`);
    }
  }

  function update() {
    const gamepad = steer();
    contacts.forEach((contact, i) => {  // a pointer at rest sends no events
      if (i !== KEYS && contact?.speed && performance.now() - contact.movedAt > REST_MS) send(i);
    });
    showVibration(gamepad);
    requestAnimationFrame(update);
  }

  // Tiles: each pixel is one sample of the model at medium speed; neighbouring rows are correlated -----------

  function paint(tile) {
    const { model, speeds, forces } = scene.surfaces[tile.dataset.index], canvas = tile.querySelector("canvas");
    const { width, height } = canvas, pen = canvas.getContext("2d"), image = pen.createImageData(width, height);
    const nSettle = 40, noise = Float64Array.from({ length: width + 2000 }, randomNoise), samples = [];
    for (let y = 0; y < height; y++) {
      noise.forEach((x, i) => { noise[i] = 0.92 * x + Math.sqrt(1 - 0.92 ** 2) * randomNoise(); });
      let n = 0;
      const renderer = createRenderer(bank, scene.index, 1, () => noise[n++ % noise.length]);
      renderer.touch(0, model);
      for (let t = -nSettle; t < width; t++) {
        const x = renderer.step(0, Math.sqrt(speeds[0] * speeds[1]), 0, Math.sqrt(forces[0] * forces[1]));
        if (t >= 0) samples.push(x);
      }
    }
    const rms = Math.sqrt(samples.reduce((sum, x) => sum + x * x, 0) / samples.length) || 1;
    const contrast = 26 + 26 * Math.max(0, Math.min(1, 1 + Math.log10(rms / scene.full_scale) / 2));
    const [red, green, blue] = getComputedStyle(canvas).color.match(/\d+/g).map(Number);
    samples.forEach((x, i) => image.data.set([red, green, blue, Math.max(0, 80 + contrast * x / rms)], 4 * i));
    pen.putImageData(image, 0, 0);
  }

  if (globalThis.AudioWorkletNode) {
    const report = (error) => showMessage(`No sound: ${error.message}. Reload the page to try again.`);
    initialization = initialize().catch(report);
  } else {
    showMessage("No sound: this browser has no AudioWorklet. Open the page in a current Firefox, Chrome, Edge or "
      + "Safari, as a local file or by https.");
  }
  const showSliderValues = () => document.querySelectorAll("input[type=range]").forEach((input) => {
    element(`${input.id}-value`).textContent = `${input.value} ${input.dataset.unit}`;
    input.setAttribute("aria-valuetext", `${input.value} ${input.dataset.unit}`);
  });
  addEventListener("input", () => { showSliderValues(); node?.port.postMessage({ gain: volume() }); });
  dark.addEventListener("change", () => tiles.forEach(paint));
  showSliderValues();
  tiles.forEach(paint);
  if (scene.scales) startSliders(scene, bank, ({ values, offset }, model, tap) => {
    bank.set(values, offset);
    node?.port.postMessage({ values, offset });
    Object.assign(scene.surfaces[0], { model, tap });
    contacts.forEach((contact, i) => { if (contact) send(i, contact.vx, contact.vy); });
    if (document.activeElement?.id.startsWith("scale-")) {  // moving a slider also strokes the surface
      slideEnd = performance.now() + 700;
      start();
    }
    clearTimeout(paintTimer);
    paintTimer = setTimeout(() => { showSliderValues(); tiles.forEach(paint); }, 200);
  });
  requestAnimationFrame(update);
})();
