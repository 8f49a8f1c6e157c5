"use strict";
// Sample loop. Functions and arrays have the same names as in texclass/haptics/scene/render_kernels.py (lattice and
// oscillators: textures/motion_renderer.py). The argument `drawNoise(contact)` returns white noise of unit variance.
// JavaScript has no fused multiply-add, so samples differ from the Python samples by a relative error of about 1e-12.

const [SMOOTHING, UPDATE_INTERVAL, FADE_SAMPLES, REST_RATIO, RADIANS_PER_HZ, OUTPUT_LIMIT] = [0, 1, 2, 3, 4, 5];
const [N_LINES, ORDER, N_SPEEDS, N_FORCES] = [0, 1, 2, 3];
const [SPEED_OFFSET, FORCE_OFFSET, ROW_OFFSET, POWER_OFFSET, LINE_OFFSET, BOUND_OFFSET] = [4, 5, 6, 7, 8, 9];
const N_COLUMNS = 10;
const [SPEED, FORCE, VOICES] = [4, 5, 6];  // columns of `state`; in Python the first four contain input and output
const [MODEL, PREVIOUS, NEXT, FADE_COUNT, UPDATE_COUNT, HAS_MOTION] = [0, 1, 2, 3, 4, 5];  // columns of `status`
const N_STATUS = 6;
const NO_MODEL = -1, UNSET = -1.0;
const MAX_INPUT = 1e9;  // largest magnitude of velocity (mm/s) and force (N)
const MAX_REFLECTION = 1 - 2 ** -53;  // largest magnitude of a reflection coefficient

/** Return a sample of unit-variance white noise, at most 3.47: a sum of four uniform random numbers. */
const randomNoise = () => (Math.random() + Math.random() + Math.random() + Math.random() - 2) * Math.sqrt(3);

/** Return whether no input is NaN or exceeds `MAX_INPUT` in magnitude. */
const isValidMotion = (vx, vy, force) =>
  Math.abs(vx) <= MAX_INPUT && Math.abs(vy) <= MAX_INPUT && Math.abs(force) <= MAX_INPUT;

/** Set `position` to [lower node, upper node, weight of the upper node] for x, which is clamped to the nodes. */
function cell(bank, offset, n, x, position) {
  if (n === 1 || x <= bank[offset]) return position.fill(0);
  position[2] = 0;
  if (x >= bank[offset + n - 1]) return position.fill(n - 1, 0, 2);
  let i = 0;
  while (x >= bank[offset + i + 1]) i++;
  position[0] = i;
  position[1] = i + 1;
  position[2] = (x - bank[offset + i]) / (bank[offset + i + 1] - bank[offset + i]);
  return position;
}

/** Filter a noise sample with the lattice: coefficients at offsets k and c, state at offset b. Return the output b_0. */
function lattice(state, x, p, k, c, b) {
  for (let m = p - 1; m >= 0; m--) {  // f_{m-1} = c f_m - k b_{m-1},  b_m = k f_m + c b_{m-1}
    const updated = state[k + m] * x + state[c + m] * state[b + m];
    x = state[c + m] * x - state[k + m] * state[b + m];
    state[b + m + 1] = updated;
  }
  return state[b] = x;
}

/** Add to x the oscillators at offsets amplitude, step and phase, and advance their phases. */
function oscillators(state, x, n, amplitude, step, phase) {
  for (let j = 0; j < n; j++) {
    if (state[step + j] < Math.PI) x += state[amplitude + j] * Math.cos(state[phase + j]);
    const angle = state[phase + j] + state[step + j];
    state[phase + j] = angle > Math.PI ? angle - 2 * Math.PI : angle;
  }
  return x;
}

/** Return { touch(contact, model), step(contact, vx, vy, force) } for the arrays `bank` and `index` of a scene. */
function createRenderer(bank, index, nContacts, drawNoise = randomNoise) {
  const column = (model, name) => index[model * N_COLUMNS + name];
  let columns = 0;
  for (let m = 0; m < index.length / N_COLUMNS; m++) {
    columns = Math.max(columns, column(m, ORDER) + column(m, N_LINES));
  }
  const span = columns + 1, voiceWidth = 3 * span, nState = VOICES + 2 * voiceWidth;
  const states = Array.from({ length: nContacts }, () => new Float64Array(nState));
  const statuses = Array.from({ length: nContacts }, () => new Int32Array(N_STATUS).fill(NO_MODEL, 0, 3));
  const speedPosition = new Float64Array(3), forcePosition = new Float64Array(3);

  function startVoice(state, contact, model, voice) {
    const p = column(model, ORDER), n = column(model, N_LINES);
    for (let m = 0; m <= p; m++) state[voice + m] = drawNoise(contact);
    for (let m = p + 1; m < p + 1 + n; m++) state[voice + m] = drawNoise(contact) * (Math.PI / 3.5);
    state[voice + 2 * span + p + n] = UNSET;
  }

  function renderVoice(state, contact, model, voice, update) {
    const p = column(model, ORDER), n = column(model, N_LINES);
    if (p + n === 0) return 0;
    const v = state[SPEED], f = state[FORCE];
    const nV = column(model, N_SPEEDS), nF = column(model, N_FORCES);
    const [i0, i1, wv] = cell(bank, column(model, SPEED_OFFSET), nV, Math.log(v), speedPosition);
    const [j0, j1, wf] = cell(bank, column(model, FORCE_OFFSET), nF, Math.log(f), forcePosition);
    const n00 = i0 * nF + j0, n01 = i0 * nF + j1, n10 = i1 * nF + j0, n11 = i1 * nF + j1;
    const w00 = (1 - wv) * (1 - wf), w01 = (1 - wv) * wf, w10 = wv * (1 - wf), w11 = wv * wf;
    const b = voice, k = voice + span, c = voice + 2 * span;
    if (update) {
      const rows = column(model, ROW_OFFSET), width = p + n;
      const a00 = rows + n00 * width, a01 = rows + n01 * width, a10 = rows + n10 * width, a11 = rows + n11 * width;
      let noiseShare = 1;
      for (let m = 0; m < width; m++) {
        let x = w00 * bank[a00 + m] + w01 * bank[a01 + m] + w10 * bank[a10 + m] + w11 * bank[a11 + m];
        if (m < p) {
          x = Math.min(Math.max(x, -MAX_REFLECTION), MAX_REFLECTION);
          state[c + m] = Math.sqrt((1 - x) * (1 + x));
        } else {
          const line = column(model, LINE_OFFSET) + m - p;
          const hz = bank[line] + bank[line + n] * v;
          state[c + m] = Math.min(hz * bank[RADIANS_PER_HZ], Math.PI);
          noiseShare -= 0.5 * x * x;
        }
        state[k + m] = x;
      }
      state[k + width] = Math.sqrt(Math.max(noiseShare, 0));
    }
    let x = 0;
    if (p > 0) x = lattice(state, drawNoise(contact), p, k, c, b) * state[k + p + n];
    x = oscillators(state, x, n, k + p, c + p, b + p + 1);
    const power = column(model, POWER_OFFSET), bounds = column(model, BOUND_OFFSET);
    const lnPower = w00 * bank[power + n00] + w01 * bank[power + n01]
      + w10 * bank[power + n10] + w11 * bank[power + n11];
    const target = Math.min(v / (bank[REST_RATIO] * bank[bounds]), 1) * Math.min(f / bank[bounds + 1], 1);
    let loudness = state[c + p + n];
    loudness = loudness < 0 ? target : loudness + bank[SMOOTHING] * (target - loudness);
    state[c + p + n] = loudness > 1e-30 ? loudness : 0;
    const limit = bank[bounds + 2];
    return Math.min(Math.max(loudness * Math.exp(0.5 * lnPower) * x, -limit), limit);
  }

  function smoothMotion(state, status, vx, vy, force) {
    const v = Math.sqrt(vx * vx + vy * vy), f = Math.max(force, 0);
    const smoothing = status[HAS_MOTION] ? bank[SMOOTHING] : 1;
    status[HAS_MOTION] = 1;
    state[SPEED] += smoothing * (v - state[SPEED]);
    state[FORCE] += smoothing * (f - state[FORCE]);
    if (state[SPEED] < 1e-30) state[SPEED] = 0;
    if (state[FORCE] < 1e-30) state[FORCE] = 0;
  }

  function startCrossfade(state, status, contact) {
    if (status[FADE_COUNT] !== 0 || status[NEXT] === status[MODEL]) return;
    state.copyWithin(VOICES + voiceWidth, VOICES, VOICES + voiceWidth);
    status[PREVIOUS] = status[MODEL];
    status[MODEL] = status[NEXT];
    status[FADE_COUNT] = 1;
    status[UPDATE_COUNT] = 0;
    if (status[MODEL] >= 0) startVoice(state, contact, status[MODEL], VOICES);
  }

  /** Return the next sample of a contact. If the input is invalid, return NaN and keep the state. */
  function step(contact, vx, vy, force) {
    if (!isValidMotion(vx, vy, force)) return NaN;
    const state = states[contact], status = statuses[contact];
    startCrossfade(state, status, contact);
    const model = status[MODEL], previous = status[PREVIOUS], fadeCount = status[FADE_COUNT];
    if (model < 0 && previous < 0) {
      status[HAS_MOTION] = 0;
      status[FADE_COUNT] = 0;
      return 0;
    }
    smoothMotion(state, status, vx, vy, force);
    const update = status[UPDATE_COUNT] === 0;
    status[UPDATE_COUNT] += 1;
    if (status[UPDATE_COUNT] >= bank[UPDATE_INTERVAL]) status[UPDATE_COUNT] = 0;
    let x = 0;
    if (model >= 0) x = renderVoice(state, contact, model, VOICES, update);
    if (fadeCount > 0) {
      const angle = 0.5 * Math.PI * fadeCount / bank[FADE_SAMPLES];
      x *= Math.sin(angle);
      if (previous >= 0) x += Math.cos(angle) * renderVoice(state, contact, previous, VOICES + voiceWidth, update);
      status[FADE_COUNT] = fadeCount + 1;
      if (fadeCount + 1 >= bank[FADE_SAMPLES]) {
        status[FADE_COUNT] = 0;
        status[PREVIOUS] = NO_MODEL;
      }
    }
    return Math.min(Math.max(x, -bank[OUTPUT_LIMIT]), bank[OUTPUT_LIMIT]);
  }

  const touch = (contact, model) => { statuses[contact][NEXT] = model; };
  return { touch, step };
}
