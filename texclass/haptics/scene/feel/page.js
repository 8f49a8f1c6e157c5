"use strict";
// Hands on tiles -> speed and force of contacts -> the worklet; what is felt -> plot, meter, words, motors.
(() => {
  const MM_PER_PX = 25.4 / 96, STALE_MS = 60, N_POINTERS = 4, KEYS = N_POINTERS, SHOWN_S = 0.15;
  const by = (id) => document.getElementById(id);
  const scene = JSON.parse(by("scene").textContent);
  const bank = new Float64Array(Uint8Array.from(atob(scene.bank), (c) => c.charCodeAt(0)).buffer);
  const tiles = [...document.querySelectorAll(".tile")];
  const calm = matchMedia("(prefers-reduced-motion: reduce)"), dark = matchMedia("(prefers-color-scheme: dark)");
  const say = (text) => { if (by("said").textContent !== text) by("said").textContent = text; };
  const volume = () => 10 ** (by("volume").value / 20);
  const contacts = Array.from({ length: N_POINTERS + 1 }, () => null);  // {tile, x, y, past, force, pointer}
  let painting = 0, slidUntil = 0, context = null, node = null, analyser = null, starting = null, touched = 0;

  // Sound --------------------------------------------------------------------------------------------------

  async function begin() {
    context = new AudioContext({ latencyHint: "interactive" });
    const text = by("kernels").textContent + by("worklet").textContent;
    const module = `data:text/javascript,${encodeURIComponent(text)}`;  // Chromium takes no Blob in a page from a file
    await context.audioWorklet.addModule(module);
    const { index, fs, full } = scene, options = { bank, index, fs, full, gain: volume(), contacts: contacts.length };
    node = new AudioWorkletNode(context, "feel",
      { numberOfInputs: 0, numberOfOutputs: 2, outputChannelCount: [1, 1], processorOptions: options });
    analyser = new AnalyserNode(context, { fftSize: 8192, smoothingTimeConstant: 0.6 });
    node.connect(context.destination, 0);
    node.connect(analyser, 1);
    node.port.onmessage = ({ data }) => {
      const { contextTime, performanceTime } = context.getOutputTimestamp();
      const late = performanceTime + 1000 * (data.sounded - contextTime) - touched;
      document.body.dataset.firstSoundMs = late.toFixed(1);
    };
    contacts.forEach((contact, i) => { if (contact) send(i); });
  }

  async function start() {  // all is ready, but sound begins with a gesture only
    touched ||= performance.now();
    await starting;
    if (context?.state === "suspended") await context.resume();
  }

  function send(i, vx = 0, vy = 0) {
    const contact = contacts[i];
    const model = contact ? scene.surfaces[contact.tile.dataset.at].model : -1;
    node?.port.postMessage({ contact: i, model, vx, vy, force: contact?.force ?? 0 });
    if (contact) Object.assign(contact, { vx, vy, speed: Math.hypot(vx, vy) });
  }

  async function tap(tile, force) {
    const { name, tap: found } = scene.surfaces[tile.dataset.at];
    start();
    if (found) node?.port.postMessage({ tap: found, velocity: 0.1 * force });
    tile.classList.remove("struck");
    void tile.offsetWidth;  // so that the ring is shown again
    tile.classList.add("struck");
    say(found ? `${name}: tapped` : `${name}: no tap is known`);
  }

  // Contacts -----------------------------------------------------------------------------------------------

  const chosenForce = () => Number(by("force").value);
  const pressed = (event) => event.pointerType !== "mouse" && event.pressure > 0 && ![0.5, 1].includes(event.pressure)
    ? scene.forces[0] + event.pressure * (scene.forces[1] - scene.forces[0]) : chosenForce();

  function show(i) {
    const dot = by(`dot-${i}`), contact = contacts[i];
    dot.hidden = !contact;
    if (!contact) return;
    contact.tile.querySelector(".face").append(dot);
    dot.style.translate = `${contact.x}px ${contact.y}px`;
  }

  function place(event) {
    const tile = document.elementFromPoint(event.clientX, event.clientY)?.closest(".tile");
    if (!tile) return null;
    const box = tile.querySelector(".face").getBoundingClientRect();
    return { tile, x: event.clientX - box.left, y: event.clientY - box.top, past: [], pointer: event.pointerId };
  }

  const held = (event) => contacts.findIndex((contact) => contact && contact.pointer === event.pointerId);

  function down(event) {
    const free = contacts.slice(0, N_POINTERS).indexOf(null), contact = place(event);
    if (!contact || free < 0 || event.button > 0) return;
    contacts[free] = { ...contact, force: pressed(event) };
    tap(contact.tile, contacts[free].force);
    send(free);
    show(free);
  }

  function move(event) {
    const i = held(event);
    if (i < 0) return;
    const found = place(event);
    if (!found) return lift(event);
    const past = [...contacts[i].past];
    const events = event.getCoalescedEvents?.() ?? [];
    for (const e of events.length ? events : [event]) past.push([e.timeStamp, e.clientX, e.clientY]);
    while (past.length > 2 && past.at(-1)[0] - past[0][0] > 40) past.shift();  // the speed of the last 40 ms
    const [t0, x0, y0] = past[0], [t1, x1, y1] = past.at(-1), seconds = Math.max(t1 - t0, 4) / 1000;
    contacts[i] = { ...found, past, force: pressed(event), at: performance.now() };
    send(i, MM_PER_PX * (x1 - x0) / seconds, MM_PER_PX * (y1 - y0) / seconds);
    show(i);
  }

  function lift(event) {
    const i = held(event);
    if (i < 0) return;
    contacts[i] = null;
    send(i);
    show(i);
  }

  by("tiles").addEventListener("pointerdown", down);
  addEventListener("pointermove", move);
  for (const kind of ["pointerup", "pointercancel"]) addEventListener(kind, lift);

  // Keys and gamepads: a finger of their own on the tile that has the focus ---------------------------------

  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const keys = new Set();
  let went = performance.now(), struck = false;

  addEventListener("keydown", (event) => {
    const tile = event.target.closest?.(".tile");
    if (!tile || event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key in ARROWS) {
      keys.add(event.key);
      start();
    } else if (["Enter", " "].includes(event.key)) {
      if (!event.repeat) tap(tile, chosenForce());
    } else return;
    event.preventDefault();
  });
  addEventListener("keyup", (event) => keys.delete(event.key));
  addEventListener("blur", () => { keys.clear(); contacts.forEach((c, i) => { contacts[i] = null; send(i); show(i); }); });

  function steer() {
    const pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected);
    const way = [...keys].reduce(([x, y], key) => [x + ARROWS[key][0], y + ARROWS[key][1]], [0, 0]);
    const size = Math.hypot(...way) || 1, stick = pad?.axes.slice(0, 2) ?? [0, 0];
    const pushed = Math.hypot(...stick) > 0.15;
    const slid = performance.now() < slidUntil, focused = document.activeElement?.closest?.(".tile");
    const go = pushed ? stick : slid && !focused ? [1, 0] : [way[0] / size, way[1] / size];
    const strikes = Boolean(pad?.buttons[0]?.pressed), tile = focused ?? (slid ? tiles[0] : null);
    const trigger = pad?.buttons[7]?.value || 0;
    if (tile && strikes && !struck) tap(tile, chosenForce());
    struck = strikes;
    const seconds = Math.min(performance.now() - went, 100) / 1000, was = contacts[KEYS];
    went = performance.now();
    if (!tile || !(go[0] || go[1])) {
      if (was) { contacts[KEYS] = null; send(KEYS); show(KEYS); }
      return pad;
    }
    const face = tile.querySelector(".face"), speed = Number(by("speed").value);
    const from = was?.tile === tile ? was : { x: face.clientWidth / 2, y: face.clientHeight / 2 };
    const wrap = (x, most) => ((x % most) + most) % most;
    const force = trigger ? scene.forces[0] + trigger * (scene.forces[1] - scene.forces[0]) : chosenForce();
    contacts[KEYS] = {
      tile, force, x: wrap(from.x + go[0] * speed * seconds / MM_PER_PX, face.clientWidth),
      y: wrap(from.y + go[1] * speed * seconds / MM_PER_PX, face.clientHeight),
    };
    send(KEYS, go[0] * speed, go[1] * speed);
    show(KEYS);
    return pad;
  }

  // What is felt -------------------------------------------------------------------------------------------

  const WORDS = [[-60, "silent"], [-42, "faint"], [-30, "soft"], [-18, "clear"], [-6, "strong"], [99, "loud"]];
  const wave = new Float32Array(8192), bands = new Float32Array(4096);
  let drawnAt = 0, buzzedAt = 0;

  function curve(canvas, values, from, to, height) {
    const pen = canvas.getContext("2d"), { width, height: tall } = canvas, style = getComputedStyle(canvas);
    pen.clearRect(0, 0, width, tall);
    pen.strokeStyle = style.color;
    pen.lineWidth = 2;
    pen.beginPath();
    for (let i = from; i < to; i++) pen.lineTo((i - from) / (to - from - 1) * width, tall * (1 - height(values[i])));
    pen.stroke();
  }

  function feel(pad) {
    if (!analyser) return;
    analyser.getFloatTimeDomainData(wave);
    const rms = Math.sqrt(wave.reduce((sum, x) => sum + x * x, 0) / wave.length);
    const heard = Math.max(20 * Math.log10(rms * volume()), -99), now = performance.now();
    if (now - buzzedAt > 60) {  // motors know a strength only
      buzzedAt = now;
      const strength = Math.min(1, rms);
      if (strength > 0.02) {
        const both = { duration: 80, weakMagnitude: strength, strongMagnitude: strength / 2 };
        pad?.vibrationActuator?.playEffect?.("dual-rumble", both)?.catch(() => {});
        if (by("buzz").checked && contacts.some(Boolean)) navigator.vibrate?.(Math.round(10 + 50 * strength));
      }
    }
    if (now - drawnAt < (calm.matches ? 500 : 33)) return;
    drawnAt = now;
    const limited = Math.max(...wave.map(Math.abs)) * volume() > CEILING;
    by("meter").value = Math.max(heard, -60);
    by("level").textContent = `${WORDS.find(([most]) => heard < most)[1]}${limited ? ", limited" : ""}`;
    by("rms").textContent = `${(rms * scene.full).toPrecision(2)} ${scene.unit}`;
    const shown = Math.round(SHOWN_S * context.sampleRate), step = context.sampleRate / 8192;
    curve(by("wave"), wave, wave.length - shown, wave.length, (x) => 0.5 + x / 6);
    analyser.getFloatFrequencyData(bands);
    const edge = Math.min(scene.fs / 2, context.sampleRate / 2);
    curve(by("spectrum"), bands, 0, Math.round(edge / step), (db) => Math.max(0, Math.min(1, 1 + db / 90)));
    const finger = contacts.find(Boolean);
    if (finger) say(`${scene.surfaces[finger.tile.dataset.at].name}: ${Math.round(finger.speed)} mm/s, `
      + `${finger.force.toFixed(1)} N`);
  }

  function turn() {
    const pad = steer();
    contacts.forEach((contact, i) => {  // a pointer at rest sends nothing
      if (i !== KEYS && contact?.speed && performance.now() - contact.at > STALE_MS) send(i);
    });
    feel(pad);
    requestAnimationFrame(turn);
  }

  // Tiles: each row is what the model plays at a middle speed, a sample a pixel, and resembles the row before -

  function paint(tile) {
    const { model, speeds, forces } = scene.surfaces[tile.dataset.at], canvas = tile.querySelector("canvas");
    const { width, height } = canvas, pen = canvas.getContext("2d"), image = pen.createImageData(width, height);
    const early = 40, noise = Float64Array.from({ length: width + 2000 }, anyNoise), rows = [];
    for (let y = 0; y < height; y++) {
      noise.forEach((x, i) => { noise[i] = 0.92 * x + Math.sqrt(1 - 0.92 ** 2) * anyNoise(); });
      let drawn = 0;
      const player = createRenderer(bank, scene.index, 1, () => noise[drawn++ % noise.length]);
      player.touch(0, model);
      for (let t = -early; t < width; t++) {
        const x = player.step(0, Math.sqrt(speeds[0] * speeds[1]), 0, Math.sqrt(forces[0] * forces[1]));
        if (t >= 0) rows.push(x);
      }
    }
    const rms = Math.sqrt(rows.reduce((sum, x) => sum + x * x, 0) / rows.length) || 1;
    const contrast = 26 + 26 * Math.max(0, Math.min(1, 1 + Math.log10(rms / scene.full) / 2));
    const [red, green, blue] = getComputedStyle(canvas).color.match(/\d+/g).map(Number);
    rows.forEach((x, i) => image.data.set([red, green, blue, Math.max(0, 80 + contrast * x / rms)], 4 * i));
    pen.putImageData(image, 0, 0);
  }

  if (globalThis.AudioWorkletNode) {
    starting = begin().catch((error) => say(`No sound: ${error.message}. Reload the page to try again.`));
  } else {
    say("This browser plays nothing here: AudioWorklet is missing. A current Firefox, Chrome, Edge or Safari has it, "
      + "for pages that are files or come by https.");
  }
  const outputs = () => document.querySelectorAll("input[type=range]").forEach((input) => {
    by(`${input.id}-is`).textContent = `${input.value} ${input.dataset.unit}`;
    input.setAttribute("aria-valuetext", `${input.value} ${input.dataset.unit}`);
  });
  addEventListener("input", () => { outputs(); node?.port.postMessage({ gain: volume() }); });
  dark.addEventListener("change", () => tiles.forEach(paint));
  outputs();
  tiles.forEach(paint);
  if (scene.scales) startSliders(scene, bank, ({ part, at }, model, tap) => {
    bank.set(part, at);
    node?.port.postMessage({ part, at });
    Object.assign(scene.surfaces[0], { model, tap });
    contacts.forEach((contact, i) => { if (contact) send(i, contact.vx, contact.vy); });
    if (document.activeElement?.id.startsWith("scale-")) {  // who moves a slider has no hand free to stroke
      slidUntil = performance.now() + 700;
      start();
    }
    clearTimeout(painting);
    painting = setTimeout(() => { outputs(); tiles.forEach(paint); }, 200);
  });
  requestAnimationFrame(turn);
})();
