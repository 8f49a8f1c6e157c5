"use strict";
// A surface that feels otherwise: of every scale, models (or taps) at some of its values; between, and of several at
// once, the base moved by what each slider does alone. A shift of atanh k leaves |k| below 1, whatever the sliders.

/** Return [i, w]: x lies w of the way from values[i] to values[i + 1]; held at both ends. */
function between(values, x) {
  const i = Math.max(0, values.findLastIndex((value, at) => value <= x && at < values.length - 1));
  return [i, Math.min(Math.max((x - values[i]) / (values[i + 1] - values[i]), 0), 1)];
}

/** Return sum_s (1 - w) rows_s[i] + w rows_s[i + 1] - (n - 1) base: `base` and rows are arrays of numbers. */
function moved(base, scales, chosen, rowsOf) {
  const sum = Float64Array.from(base);
  for (const [name, scale] of Object.entries(scales)) {
    const rows = rowsOf(scale);
    if (!rows) continue;
    const [i, w] = between(scale.values, chosen[name]);
    sum.forEach((_, m) => { sum[m] += (1 - w) * rows[i][m] + w * rows[i + 1][m] - base[m]; });
  }
  return sum;
}

/** Return the part of `bank` that stands for the model of `chosen`, and where it belongs for the model `into`. */
function blended(bank, index, scales, chosen, into) {
  const of = (model, column) => index[model * N_INDEX + column];
  const at = (model) => of(model, AT_SPEEDS), size = of(0, AT_BOUNDS) + 3 - at(0);
  const rows = of(0, AT_ROWS) - at(0), rowsEnd = of(0, AT_POWER) - at(0), limit = size - 1;
  const each = (to, toLimit) => (x, m) => m >= rows && m < rowsEnd ? to(x) : m === limit ? toLimit(x) : x;
  const part = (model) => bank.slice(at(model), at(model) + size).map(each(Math.atanh, Math.log));
  const sum = moved(part(0), scales, chosen, ({ models }) => models?.map(part));
  return { part: sum.map(each(Math.tanh, Math.exp)), at: at(into) };
}

/** Return the modes [amplitude, decay, hz, phase] of the tap of `chosen`. */
function blendedTap(tap, scales, chosen) {
  const flat = (modes) => modes.flatMap(([a, b, hz, phase]) => [Math.log(a), Math.log(b), Math.log(hz), phase]);
  const sum = moved(flat(tap), scales, chosen, ({ taps }) => taps?.map(flat));
  return tap.map((_, i) => [...sum.slice(4 * i, 4 * i + 3).map(Math.exp), sum[4 * i + 3]]);
}

/** Let the sliders of the page choose what is played: `play(part, model, tap)` takes it from then on. */
function startSliders({ scales, command, index, surfaces }, bank, play) {
  const by = (id) => document.getElementById(id), original = surfaces[0].tap, last = index.length / N_INDEX - 1;
  let into = last;

  function renew() {
    const chosen = {}, words = [];
    for (const [name, { value }] of Object.entries(scales)) {
      chosen[name] = Number(by(`scale-${name}`).value);
      if (Math.abs(chosen[name] - value) > 0.04) words.push(`--scale ${name}=${chosen[name]}`);
    }
    by("command").value = words.length ? `${command} ${words.join(" ")}` : "Move a slider: the surface is as it was.";
    into = into === last ? last - 1 : last;  // the one that is not being played, so that they cross over
    play(blended(bank, index, scales, chosen, into), into, original && blendedTap(original, scales, chosen));
  }

  let due = false;
  addEventListener("input", ({ target }) => {
    if (!target.id.startsWith("scale-") || due) return;
    due = true;
    setTimeout(() => { due = false; renew(); }, 50);  // longer than they take to cross over
  });
  by("reset").addEventListener("click", () => {
    for (const [name, { value }] of Object.entries(scales)) by(`scale-${name}`).value = value;
    by("reset").dispatchEvent(new Event("input", { bubbles: true }));
    renew();
  });
  by("copy").addEventListener("click", async () => {
    by("command").select();
    try {
      await navigator.clipboard.writeText(by("command").value);
      by("said").textContent = "The command is copied.";
    } catch {
      by("said").textContent = "The command is selected: copy it with Ctrl+C.";
    }
  });
  renew();
}
