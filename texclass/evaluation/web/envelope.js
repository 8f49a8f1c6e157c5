"use strict";
// Minimum and maximum of a long signal in any part of it, and the ticks of an axis.
const FACTOR = 4;  // ratio of the block lengths of two levels
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

// Levels of the envelope: level 0 as stored, each further level with 4 times longer blocks.
function envelope({ block, values, is_envelope: isEnvelope, scale, offset }) {
  const bytes = Uint8Array.from(atob(values), (c) => c.charCodeAt(0));
  const raw = Float32Array.from(new Int16Array(bytes.buffer), (v) => v * scale + offset);
  const half = raw.length / 2;
  const levels = [isEnvelope ? { size: block, low: raw.subarray(0, half), high: raw.subarray(half) } : { size: block, low: raw, high: raw }];
  while (levels.at(-1).low.length > 1000) {
    const { size, low, high } = levels.at(-1), m = Math.ceil(low.length / FACTOR);
    const next = { size: size * FACTOR, low: new Float32Array(m).fill(Infinity), high: new Float32Array(m).fill(-Infinity) };
    for (let i = 0; i < low.length; i++) {
      const j = Math.floor(i / FACTOR);
      if (low[i] < next.low[j]) next.low[j] = low[i];
      if (high[i] > next.high[j]) next.high[j] = high[i];
    }
    levels.push(next);
  }
  return levels;
}
// Returns minimum and maximum of the samples in [first, last).
function range(levels, first, last) {
  const level = levels.findLast(({ size }) => size <= Math.max(1, (last - first) / 2)) ?? levels[0];
  const start = clamp(Math.floor(first / level.size), 0, level.low.length - 1);
  const stop = clamp(Math.ceil(last / level.size), start + 1, level.low.length);
  let low = Infinity, high = -Infinity;
  for (let i = start; i < stop; i++) {
    if (level.low[i] < low) low = level.low[i];
    if (level.high[i] > high) high = level.high[i];
  }
  return [low, high];
}

function ticks(low, high, count) {
  const ideal = (high - low) / count, power = 10 ** Math.floor(Math.log10(ideal));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= ideal) ?? ideal;
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), list = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) list.push([k * step, (k * step).toFixed(Math.min(digits, 12))]);
  return list;
}
