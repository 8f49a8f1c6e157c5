"use strict";
// Taps, movement and surfaces of a recording as intervals that users drag, add and delete. All positions are numbers of
// samples; `text` converts them to the content of a phases file.
(() => {
  const LANES = ["taps", "movement", "surfaces"], NAMES = { taps: "Tap", movement: "Movement", surfaces: "Surface" };
  const PARTS = { whole: "whole interval", start: "start", impact: "contact", end: "end" };
  const EDGE_PX = 9, ADD_TAP_S = 0.05, COALESCE_MS = 1000;
  const element = (id) => document.getElementById(id);
  const data = JSON.parse(element("data").textContent);
  const fs = data.content.fs_hz, n = data.n_samples, plot = element("plot");
  const canvases = [...plot.querySelectorAll("canvas")];
  const seconds = (k) => (k / fs).toFixed(fs > 2000 ? 4 : 3);
  const sample = (s) => clamp(Math.round(s * fs), 0, n);
  // A file name as a word of a shell.
  const quoted = (name) => (/^[\w.,@%+=:-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`);

  // State --------------------------------------------------------------------------------------------------

  let nextId = 1, selected = null, part = "whole", cursor = n / 2, view = { first: 0, last: n };
  let handle = null, elements = new Map(), lastTag = "", lastTime = 0;
  const state = {};
  for (const lane of LANES) {
    state[lane] = data.content[lane].map((one) => ({
      id: nextId++, start: sample(one.start_s), end: sample(one.end_s),
      ...(lane === "taps" && { impact: sample(one.impact_s), width_s: one.width_s, quality: one.quality }),
      ...(lane === "surfaces" && { surface: one.surface }),
    }));
  }
  const snapshot = () => JSON.stringify(state);
  const undone = [], done = [snapshot()];
  const items = () => LANES.flatMap((lane) => state[lane]);
  const laneOf = (item) => LANES.find((lane) => state[lane].includes(item));
  const nameOf = (item) => `${NAMES[laneOf(item)]} ${state[laneOf(item)].indexOf(item) + 1}`;

  function content() {
    const time = ({ start, end }) => ({ start_s: start / fs, end_s: end / fs });
    const { taps, movement, surfaces, ...head } = data.content;
    return {
      ...head,
      taps: state.taps.map((tap) => ({ ...time(tap), impact_s: tap.impact / fs, width_s: tap.width_s, quality: tap.quality })),
      movement: state.movement.map(time),
      surfaces: state.surfaces.map((one) => ({ ...time(one), surface: one.surface.trim() })),
    };
  }
  const text = () => `${JSON.stringify(content(), null, 1)}\n`;
  let savedText = text();
  const isChanged = () => text() !== savedText;

  function problems() {
    const found = [], inside = (one, part) => one.start < part.end && part.start < one.end;
    if (state.movement.length > 1 && !state.surfaces.length) {
      found.push(`There are ${state.movement.length} intervals of movement, but no surfaces. Join the intervals, or mark a surface for each.`);
    }
    state.surfaces.forEach((part, i) => {
      if (!part.surface.trim()) found.push(`Surface ${i + 1} has no name.`);
      const count = state.movement.filter((one) => inside(one, part)).length;
      if (count > 1) found.push(`Surface ${i + 1} contains ${count} intervals of movement. Join them, or divide the surface.`);
    });
    return found;
  }

  // Records the state for undo. Quick changes with the same tag, such as repeated arrow keys, count as one.
  function commit(tag = "") {
    const now = snapshot(), time = performance.now();
    if (now === done.at(-1)) return;
    if (tag && tag === lastTag && time - lastTime < COALESCE_MS) done[done.length - 1] = now;
    else done.push(now);
    [lastTag, lastTime] = [tag, time];
    undone.length = 0;
    update();
  }

  function restore(from, to, message) {
    if (from.length < (from === done ? 2 : 1)) return;
    to.push(from.pop());
    const selectedId = selected?.id;
    selected = null;
    Object.assign(state, JSON.parse(done.at(-1)));
    lastTag = "";
    rebuild();
    select(items().find((item) => item.id === selectedId) ?? null, true);
    say(message);
  }
  const undo = () => restore(done, undone, "Undone.");
  const redo = () => restore(undone, done, "Redone.");

  // Moves a part of an interval by `delta` samples from the interval `origin`, up to its neighbours.
  function move(item, part, delta, origin = { ...item }) {
    const lane = state[laneOf(item)], i = lane.indexOf(item);
    const low = lane[i - 1]?.end ?? 0, high = lane[i + 1]?.start ?? n, { start, impact, end } = origin;
    const isTap = impact !== undefined;
    delta = Math.round(delta);
    if (part === "whole") delta = clamp(delta, low - start, high - end);
    if (part === "whole" || part === "start") item.start = clamp(start + delta, low, part === "start" ? (isTap ? impact : end - 1) : n);
    if (part === "whole" || part === "end") item.end = clamp(end + delta, part === "end" ? (isTap ? impact : start) + 1 : 0, high);
    if (isTap && (part === "whole" || part === "impact")) item.impact = clamp(impact + delta, item.start, item.end - 1);
    if (isTap && item.impact !== impact) [item.width_s, item.quality] = [0, 1];  // the values of a detected tap no longer apply
  }

  function add(lane, at = cursor) {
    at = clamp(Math.round(at), 0, n - 1);
    const list = state[lane], index = list.filter((one) => one.end <= at).length;
    if (list[index]?.start <= at) {
      select(list[index], true);
      return say(`${nameOf(list[index])} is already at ${seconds(at)} s.`);
    }
    const low = list[index - 1]?.end ?? 0, high = list[index]?.start ?? n, third = Math.ceil((view.last - view.first) / 3);
    const item = { id: nextId++, start: at, end: Math.min(at + third, high) };
    if (lane === "taps") {
      const length = Math.max(1, Math.round(ADD_TAP_S * fs));
      Object.assign(item, { start: Math.max(at - length, low), impact: at, end: Math.min(at + length, high), width_s: 0, quality: 1 });
    }
    if (lane === "surfaces") item.surface = "";
    list.splice(index, 0, item);
    rebuild();
    select(item, true);
    commit();
    if (lane === "surfaces") element("surface").focus();
    say(`${nameOf(item)} added at ${seconds(at)} s.`);
  }

  function remove(item = selected) {
    if (!item) return say("Select an interval first.");
    const lane = laneOf(item), name = nameOf(item), i = state[lane].indexOf(item);
    state[lane].splice(i, 1);
    selected = null;
    rebuild();
    select(state[lane][Math.min(i, state[lane].length - 1)] ?? null, true);
    commit();
    say(`${name} deleted.`);
  }

  // View ---------------------------------------------------------------------------------------------------

  const width = () => canvases[0].clientWidth || 1;
  const toX = (k) => (k - view.first) / (view.last - view.first) * width();
  const toSample = (x) => view.first + x / width() * (view.last - view.first);
  const minView = () => Math.min(n, 20);

  function show(first, last) {
    const size = clamp(last - first, minView(), n);
    first = clamp(first, 0, n - size);
    view = { first, last: first + size };
    update();
  }
  function zoom(factor, at = (view.first + view.last) / 2) {
    const size = clamp((view.last - view.first) * factor, minView(), n), share = (at - view.first) / (view.last - view.first);
    show(at - share * size, at - share * size + size);
  }
  function zoomTo(item) {
    if (!item) return say("Select an interval first.");
    const margin = Math.max(5, 0.5 * (item.end - item.start));
    show(item.start - margin, item.end + margin);
  }
  // The step of the arrow keys: about 1/500 of the visible part, 1, 2 or 5 times a power of ten in seconds.
  function stepSize() {
    const ideal = (view.last - view.first) / fs / 500, power = 10 ** Math.floor(Math.log10(ideal));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= ideal * 0.999);
    return Math.max(1, Math.round(step * fs));
  }

  const envelopes = data.traces.map(envelope);

  function paint(canvas, index) {
    const ratio = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (canvas.width !== Math.round(w * ratio)) canvas.width = Math.round(w * ratio);
    if (canvas.height !== Math.round(h * ratio)) canvas.height = Math.round(h * ratio);
    const style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(`--${name}`).trim();
    const c = canvas.getContext("2d"), trace = data.traces[index], levels = envelopes[index], isFirst = index === 0;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, w, h);
    const bottom = isFirst ? h - 20 : h, perPixel = (view.last - view.first) / w;
    let [low, high] = range(levels, view.first, view.last);
    const margin = 0.06 * (high - low || 1);
    [low, high] = [low - margin, high + margin];
    const toY = (v) => bottom - (v - low) / (high - low) * bottom;
    const colours = { taps: colour("other"), movement: colour("third"), surfaces: colour("fourth") };
    for (const lane of LANES) {
      for (const item of state[lane]) {
        const x0 = toX(item.start), x1 = Math.max(toX(item.end), x0 + 1);
        if (x1 < 0 || x0 > w) continue;
        const isSelected = item === selected;
        c.fillStyle = c.strokeStyle = colours[lane];
        if (lane !== "surfaces" || isSelected) {
          c.globalAlpha = isSelected ? 0.3 : 0.16;
          c.fillRect(x0, 0, x1 - x0, bottom);
        }
        c.globalAlpha = 1;
        c.lineWidth = isSelected ? 2 : 1;
        c.setLineDash(lane === "surfaces" ? [6, 4] : []);
        const lines = [...(isSelected || lane === "surfaces" ? [x0, x1] : []), ...(lane === "taps" ? [toX(item.impact)] : [])];
        for (const x of lines) {
          c.beginPath();
          c.moveTo(x, 0);
          c.lineTo(x, bottom);
          c.stroke();
        }
        c.setLineDash([]);
      }
    }
    c.font = "12px system-ui, sans-serif";
    c.fillStyle = colour("muted");
    c.strokeStyle = colour("grid");
    c.lineWidth = 1;
    for (const [value, label] of ticks(low, high, Math.max(2, bottom / 40))) {
      const y = Math.round(toY(value)) + 0.5;
      c.beginPath();
      c.moveTo(0, y);
      c.lineTo(w, y);
      c.stroke();
      if (y > 30 && y < bottom - 8) c.fillText(label, 4, y - 3);
    }
    if (isFirst) {
      for (const [value, label] of ticks(view.first / fs, view.last / fs, Math.max(2, w / 110))) {
        const x = toX(value * fs);
        c.beginPath();
        c.moveTo(x, bottom);
        c.lineTo(x, bottom + 5);
        c.stroke();
        const size = c.measureText(`${label} s`).width;
        c.fillText(`${label} s`, clamp(x - size / 2, 0, w - size), h - 4);
      }
    }
    c.strokeStyle = c.fillStyle = colour("ink");
    c.lineWidth = 1;
    c.beginPath();
    if (perPixel < levels[0].size * 1.5) {  // a line from block to block
      const { size, low: lows, high: highs } = levels[0];
      const last = Math.min(lows.length - 1, Math.ceil(view.last / size) + 1);
      for (let i = Math.max(0, Math.floor(view.first / size) - 1); i <= last; i++) {
        const x = toX((i + 0.5) * size - 0.5);
        c.lineTo(x, toY(lows[i]));
        if (highs[i] !== lows[i]) c.lineTo(x, toY(highs[i]));
      }
    } else {
      for (let x = 0; x < w; x++) {
        const [v0, v1] = range(levels, toSample(x) - levels[0].size, toSample(x + 1));  // no gaps between columns
        c.moveTo(x + 0.5, toY(v0) + 0.5);
        c.lineTo(x + 0.5, toY(v1) - 0.5);
      }
    }
    c.stroke();
    c.fillStyle = colour("muted");
    c.fillText(`${trace.name} (${trace.unit})`, 6, 14);
    c.strokeStyle = colour("focus");
    c.setLineDash([3, 3]);
    c.beginPath();
    c.moveTo(toX(cursor), 0);
    c.lineTo(toX(cursor), bottom);
    c.stroke();
    c.setLineDash([]);
  }

  // Elements -----------------------------------------------------------------------------------------------

  function rebuild() {
    for (const old of elements.values()) old.remove();
    elements = new Map();
    for (const lane of LANES) {
      for (const item of state[lane]) {
        const box = document.createElement("div");
        box.className = "interval";
        box.tabIndex = 0;
        box.setAttribute("role", "slider");
        box.dataset.id = item.id;
        if (lane === "taps") box.append(Object.assign(document.createElement("span"), { className: "hand" }));
        box.append(Object.assign(document.createElement("span"), { className: "text" }));
        box.addEventListener("focus", () => select(item, false));
        box.addEventListener("pointerdown", (event) => startDrag(event, item, partAt(item, event)));
        box.addEventListener("pointermove", (event) => box.classList.toggle("near", partAt(item, event) !== "whole"));
        box.addEventListener("dblclick", (event) => { event.stopPropagation(); zoomTo(item); });
        element(lane).append(box);
        elements.set(item.id, box);
      }
    }
    update();
  }

  let frame = 0;
  function update() {
    for (const item of items()) {
      const box = elements.get(item.id), lane = laneOf(item);
      if (!box) continue;
      const x0 = toX(item.start), x1 = toX(item.end), size = Math.max(6, x1 - x0);
      // Browsers do not draw elements that are very wide, and the text has to stay in the visible part.
      const left = Math.max(x0, -20), right = Math.min(x0 + size, width() + 20);
      box.hidden = right <= left;
      box.style.left = `${left}px`;
      box.style.width = `${Math.max(6, right - left)}px`;
      const isSelected = item === selected, active = isSelected ? part : "whole";
      box.classList.toggle("selected", isSelected);
      const value = active === "whole" ? item.start : item[active];
      box.setAttribute("aria-label", lane === "surfaces" && item.surface ? `${nameOf(item)}, ${item.surface}` : nameOf(item));
      box.setAttribute("aria-valuemin", 0);
      box.setAttribute("aria-valuemax", n / fs);
      box.setAttribute("aria-valuenow", value / fs);
      const contact = lane === "taps" ? `, contact ${seconds(item.impact)} s` : "";
      box.setAttribute("aria-valuetext", `${seconds(item.start)} to ${seconds(item.end)} s${contact}; arrow keys move the ${PARTS[active]}`);
      box.querySelector(".text").style.left = `${Math.max(5, 5 - left)}px`;
      box.querySelector(".text").textContent = lane === "surfaces" ? item.surface || "no name" : lane === "movement" ? "movement" : "";
      const hand = box.querySelector(".hand");
      if (hand) hand.style.width = `${clamp(toX(item.impact) - left, 0, size)}px`;
    }
    element("undo").disabled = done.length < 2;
    element("redo").disabled = !undone.length;
    element("selected").disabled = !selected;
    element("selected-name").textContent = selected ? nameOf(selected) : "Nothing selected";
    element("impact-field").hidden = selected?.impact === undefined;
    element("surface-field").hidden = selected?.surface === undefined;
    for (const name of ["start", "impact", "end"]) {
      const field = element(name);
      if (document.activeElement !== field) field.value = selected?.[name] === undefined ? "" : seconds(selected[name]);
    }
    if (document.activeElement !== element("surface")) element("surface").value = selected?.surface ?? "";
    const names = new Set([...data.surfaces, ...state.surfaces.map((one) => one.surface.trim())]);
    element("known-surfaces").replaceChildren(...[...names].filter(Boolean).sort().map((name) => new Option(name, name)));
    element("problems").replaceChildren(...problems().map((problem) => Object.assign(document.createElement("li"), { textContent: problem })));
    const hiddenSamples = n - (view.last - view.first), position = element("position");
    position.disabled = hiddenSamples <= 0;
    if (document.activeElement !== position) position.value = hiddenSamples > 0 ? 1000 * view.first / hiddenSamples : 0;
    canvases[0].setAttribute("aria-valuenow", cursor / fs);
    canvases[0].setAttribute("aria-valuetext", `${seconds(cursor)} s`);
    document.title = `${isChanged() ? "* " : ""}${data.title}`;
    cancelAnimationFrame(frame);
    frame = requestAnimationFrame(() => canvases.forEach(paint));
  }

  function say(message) {
    element("status").textContent = message;
  }

  function select(item, focus) {
    if (item !== selected) part = "whole";
    selected = item;
    update();
    if (!item) return;
    if (item.end < view.first || item.start > view.last) {
      const half = (view.last - view.first) / 2, middle = (item.start + item.end) / 2;
      show(middle - half, middle + half);
    }
    const box = elements.get(item.id);
    if (focus && document.activeElement !== box) box.focus();
  }

  function describe(item) {
    const contact = item.impact === undefined ? "" : `, contact ${seconds(item.impact)} s`;
    say(`${nameOf(item)}: ${seconds(item.start)} to ${seconds(item.end)} s${contact}.`);
  }

  // Pointers -----------------------------------------------------------------------------------------------

  const plotX = (event) => event.clientX - canvases[0].getBoundingClientRect().left;

  // Returns the edge near a pointer, or "whole". The middle half of a short interval always moves the whole.
  function partAt(item, event) {
    const x = plotX(event), names = item.impact === undefined ? ["start", "end"] : ["start", "impact", "end"];
    const tolerance = Math.min(EDGE_PX, (toX(item.end) - toX(item.start)) / 6);
    const [nearest] = names.map((name) => [Math.abs(toX(item[name]) - x), name]).sort((a, b) => a[0] - b[0]);
    return nearest[0] <= tolerance ? nearest[1] : "whole";
  }

  function startDrag(event, item, dragged) {
    if (event.button !== 0) return;
    event.preventDefault();
    event.stopPropagation();
    select(item, true);
    const origin = { ...item }, x = plotX(event), target = event.currentTarget;
    let isCancelled = false;
    target.setPointerCapture(event.pointerId);
    const drag = (e) => {
      move(item, dragged, (plotX(e) - x) * (view.last - view.first) / width(), origin);
      describe(item);
      update();
    };
    const cancel = (e) => {
      if (e.key !== "Escape") return;
      Object.assign(item, origin);
      isCancelled = true;
      stop();
      say("Not moved.");
      update();
    };
    const stop = () => {
      target.removeEventListener("pointermove", drag);
      document.removeEventListener("keydown", cancel, true);
      for (const name of ["pointerup", "pointercancel"]) target.removeEventListener(name, stop);
      if (!isCancelled) commit();
    };
    target.addEventListener("pointermove", drag);
    document.addEventListener("keydown", cancel, true);
    for (const name of ["pointerup", "pointercancel"]) target.addEventListener(name, stop);
  }

  function edgeAt(event) {  // an edge of the selected interval near a pointer on the signal
    if (!selected) return null;
    const x = plotX(event), names = ["start", "impact", "end"].filter((name) => selected[name] !== undefined);
    const [nearest] = names.map((name) => [Math.abs(toX(selected[name]) - x), name]).sort((a, b) => a[0] - b[0]);
    return nearest[0] <= EDGE_PX ? nearest[1] : null;
  }

  for (const canvas of canvases) {
    canvas.addEventListener("pointerdown", (event) => {
      const edge = edgeAt(event);
      if (edge) return startDrag(event, selected, edge);
      if (event.button !== 0) return undefined;
      const x = plotX(event), { first, last } = view;
      let isMoved = false;
      canvas.setPointerCapture(event.pointerId);
      const pan = (e) => {
        isMoved ||= Math.abs(plotX(e) - x) > 4;
        if (isMoved) show(first - (plotX(e) - x) * (last - first) / width(), last - (plotX(e) - x) * (last - first) / width());
      };
      const end = new AbortController(), { signal } = end;
      canvas.addEventListener("pointermove", pan, { signal });
      canvas.addEventListener("pointercancel", () => end.abort(), { signal });
      canvas.addEventListener("pointerup", () => {
        end.abort();
        if (!isMoved) setCursor(toSample(x));
      }, { signal });
      return undefined;
    });
    canvas.addEventListener("pointermove", (event) => canvas.classList.toggle("on-edge", edgeAt(event) !== null));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const size = view.last - view.first;
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) show(view.first + event.deltaX / width() * size, view.last + event.deltaX / width() * size);
      else zoom(2 ** (clamp(event.deltaY, -200, 200) / 200), toSample(plotX(event)));
    }, { passive: false });
  }
  for (const lane of LANES) {
    element(lane).addEventListener("dblclick", (event) => { setCursor(toSample(plotX(event))); add(lane); });
  }

  function setCursor(k) {
    cursor = clamp(Math.round(k), 0, n - 1);
    say(`Cursor: ${seconds(cursor)} s.`);
    update();
  }

  // Keys and fields ----------------------------------------------------------------------------------------

  function arrow(event) {
    const sign = { ArrowLeft: -1, ArrowDown: -1, PageDown: -1, ArrowRight: 1, ArrowUp: 1, PageUp: 1 }[event.key];
    const item = elements.get(selected?.id) === document.activeElement ? selected : null;
    if (!sign || !(item || document.activeElement === canvases[0])) return false;
    const delta = sign * stepSize() * (event.shiftKey || event.key.startsWith("Page") ? 10 : 1);
    if (!item) {
      setCursor(cursor + delta);
      if (cursor < view.first || cursor > view.last) show(view.first + delta, view.last + delta);
      return true;
    }
    const moved = event.altKey ? "end" : part;
    move(item, moved, delta);
    describe(item);
    commit(`${item.id} ${moved}`);
    return true;
  }

  function nextPart() {
    if (!selected) return;
    const names = ["whole", "start", ...(selected.impact === undefined ? [] : ["impact"]), "end"];
    part = names[(names.indexOf(part) + 1) % names.length];
    say(`${nameOf(selected)}: arrow keys move the ${PARTS[part]}.`);
    update();
  }

  const letters = {
    t: () => add("taps"), m: () => add("movement"), s: () => add("surfaces"), z: () => zoomTo(selected),
    "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), 0: () => show(0, n), "?": () => element("keys").showModal(),
    Delete: () => remove(), Backspace: () => remove(),
  };
  document.addEventListener("keydown", (event) => {
    const command = event.ctrlKey || event.metaKey, key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const isField = event.target.matches?.("input, button, textarea, select"), isText = event.target.matches?.("input[type=text], input[type=number]");
    let isHandled = true;
    if (command && key === "s") save();
    else if (element("keys").open) isHandled = false;
    else if (command && key === "z" && !isText) (event.shiftKey ? redo : undo)();
    else if (command && key === "y" && !isText) redo();
    else if (command || isText) isHandled = false;
    else if (event.target.matches?.(".interval") && (key === "Enter" || key === " ")) nextPart();
    else if (event.target.matches?.(".interval") && key === "Escape" && part !== "whole") { part = "end"; nextPart(); }
    else if (letters[key] && !event.altKey && !(isField && key.length > 1)) letters[key]();
    else isHandled = !isField && arrow(event);
    if (isHandled) event.preventDefault();
  });

  for (const name of ["start", "impact", "end"]) {
    element(name).addEventListener("change", ({ target }) => {
      if (!selected || target.value === "" || !Number.isFinite(target.valueAsNumber)) return update();
      move(selected, name, Math.round(target.valueAsNumber * fs) - selected[name]);
      target.value = seconds(selected[name]);
      describe(selected);
      return commit();
    });
  }
  element("surface").addEventListener("input", ({ target }) => {
    if (!selected || selected.surface === undefined) return;
    selected.surface = target.value;
    commit(`${selected.id} surface`);
  });
  element("position").addEventListener("input", ({ target }) => {
    const size = view.last - view.first, first = target.value / 1000 * (n - size);
    show(first, first + size);
  });
  const clicks = {
    "add-taps": letters.t, "add-movement": letters.m, "add-surfaces": letters.s, undo, redo, save: () => save(),
    "zoom-in": letters["+"], "zoom-out": letters["-"], "zoom-all": letters[0], help: letters["?"],
    "zoom-selected": letters.z, delete: () => remove(),
  };
  for (const [id, click] of Object.entries(clicks)) element(id).addEventListener("click", () => click());

  // Saving -------------------------------------------------------------------------------------------------

  async function save() {
    const [problem] = problems(), written = text();
    if (problem) return say(`Not saved. ${problem}`);
    try {
      if (window.showSaveFilePicker) {
        const types = [{ description: "Phases", accept: { "application/json": [".json"] } }];
        handle ??= await window.showSaveFilePicker({ suggestedName: data.file_name, types });
        const file = await handle.createWritable();
        await file.write(written);
        await file.close();
        const isNamed = handle.name === data.file_name;
        say(isNamed ? `Saved ${handle.name}. It is used if it is next to the recording: ${data.path}`
          : `Saved ${handle.name}, but only the name ${data.file_name} is used. To copy it, run: ${data.command} ${quoted(handle.name)}`);
        if (!isNamed) handle = null;
      } else {
        const link = document.createElement("a");
        link.href = URL.createObjectURL(new Blob([written], { type: "application/json" }));
        link.download = data.file_name;
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 10000);
        say(`Downloaded ${data.file_name}. Move it to ${data.path}, or run: ${data.command} ~/Downloads/${quoted(data.file_name)}`);
      }
    } catch (error) {
      handle = null;
      return say(error.name === "AbortError" ? "Not saved: cancelled." : `Not saved: ${error.message}`);
    }
    savedText = written;
    return update();
  }
  addEventListener("beforeunload", (event) => { if (isChanged()) event.preventDefault(); });

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", update);
  new ResizeObserver(update).observe(plot);
  rebuild();
  say("Select an interval with Tab or the pointer. Press ? for the keys.");
})();
