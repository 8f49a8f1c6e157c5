"use strict";
// Sliders of a texture. Each scale has models (or taps) at a few values, which are interpolated in between. The
// changes due to several sliders are added to the base model. Reflection coefficients are added as atanh k, which
// keeps |k| below 1 for all slider positions.

/** Return [i, w], where x is at fraction w between values[i] and values[i + 1]; x is clamped to the range of values. */
function interpolationCell(values, x) {
  const i = Math.max(0, values.findLastIndex((value, j) => value <= x && j < values.length - 1));
  return [i, Math.min(Math.max((x - values[i]) / (values[i + 1] - values[i]), 0), 1)];
}

/** Return sum_s (1 - w) rows_s[i] + w rows_s[i + 1] - (n - 1) base; `base` and all rows are arrays of numbers. */
function addChanges(base, scales, sliderValues, rowsOf) {
  const sum = Float64Array.from(base);
  for (const [name, scale] of Object.entries(scales)) {
    const rows = rowsOf(scale);
    if (!rows) continue;
    const [i, w] = interpolationCell(scale.values, sliderValues[name]);
    sum.forEach((_, m) => { sum[m] += (1 - w) * rows[i][m] + w * rows[i + 1][m] - base[m]; });
  }
  return sum;
}

/** Return the data of the model for `sliderValues`, and the offset in `bank` at which model `target` is stored. */
function blendModels(bank, index, scales, sliderValues, target) {
  const column = (model, name) => index[model * N_COLUMNS + name];
  const begin = (model) => column(model, SPEED_OFFSET), size = column(0, BOUND_OFFSET) + 3 - begin(0);
  const rows = column(0, ROW_OFFSET) - begin(0), rowsEnd = column(0, POWER_OFFSET) - begin(0), limit = size - 1;
  const map = (toRow, toLimit) => (x, m) => m >= rows && m < rowsEnd ? toRow(x) : m === limit ? toLimit(x) : x;
  const numbers = (model) => bank.slice(begin(model), begin(model) + size).map(map(Math.atanh, Math.log));
  const sum = addChanges(numbers(0), scales, sliderValues, ({ models }) => models?.map(numbers));
  return { values: sum.map(map(Math.tanh, Math.exp)), offset: begin(target) };
}

/** Return the modes [amplitude, decay, hz, phase] of the tap for `sliderValues`. */
function blendTaps(tap, scales, sliderValues) {
  const flatten = (modes) => modes.flatMap(([a, b, hz, phase]) => [Math.log(a), Math.log(b), Math.log(hz), phase]);
  const sum = addChanges(flatten(tap), scales, sliderValues, ({ taps }) => taps?.map(flatten));
  return tap.map((_, i) => [...sum.slice(4 * i, 4 * i + 3).map(Math.exp), sum[4 * i + 3]]);
}

/** Connect the sliders of the page to `onChange({ values, offset }, target, tap)`, which is called after each change. */
function startSliders({ scales, command, index, surfaces }, bank, onChange) {
  const element = (id) => document.getElementById(id), tap = surfaces[0].tap, last = index.length / N_COLUMNS - 1;
  let target = last;

  function update() {
    const sliderValues = {}, options = [];
    for (const [name, { value }] of Object.entries(scales)) {
      sliderValues[name] = Number(element(`scale-${name}`).value);
      if (Math.abs(sliderValues[name] - value) > 0.04) options.push(`--scale ${name}=${sliderValues[name]}`);
    }
    element("command").value = options.length
      ? `${command} ${options.join(" ")}` : "The surface is unchanged. Move a slider to create a command.";
    target = target === last ? last - 1 : last;  // two models alternate, so that the renderer crossfades
    const model = blendModels(bank, index, scales, sliderValues, target);
    onChange(model, target, tap && blendTaps(tap, scales, sliderValues));
  }

  let isScheduled = false;
  addEventListener("input", ({ target: { id } }) => {
    if (!id.startsWith("scale-") || isScheduled) return;
    isScheduled = true;
    setTimeout(() => { isScheduled = false; update(); }, 50);  // longer than a crossfade
  });
  element("reset").addEventListener("click", () => {
    for (const [name, { value }] of Object.entries(scales)) element(`scale-${name}`).value = value;
    element("reset").dispatchEvent(new Event("input", { bubbles: true }));
    update();
  });
  element("copy").addEventListener("click", async () => {
    element("command").select();
    try {
      await navigator.clipboard.writeText(element("command").value);
      element("status").textContent = "Command copied.";
    } catch {
      element("status").textContent = "Press Ctrl+C to copy the selected command.";
    }
  });
  update();
}
