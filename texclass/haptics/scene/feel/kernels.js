"use strict";
// The loop over samples: texclass/haptics/scene/render_kernels.py, function by function, with its names and arrays
// (lattice, oscillators: textures/motion_renderer.py).
// `draw(contact)` is the noise, white and of unit variance; it comes from outside. A fused multiply-add is two
// roundings here: samples differ by parts in 1e12 from those of Python.

const [GLIDE, HOP, FADE, STILL, RADIANS, OUTPUT] = [0, 1, 2, 3, 4, 5];
const [N_LINES, ORDER, N_SPEEDS, N_FORCES, AT_SPEEDS, AT_FORCES, AT_ROWS, AT_POWER, AT_COURSE, AT_BOUNDS] =
  [0, 1, 2, 3, 4, 5, 6, 7, 8, 9];
const N_INDEX = 10;
const [SPEED, FORCE, VOICES] = [4, 5, 6];  // columns of `state`; before them stand motion and sample in Python
const [MODEL, OTHER, WANTED, FADED, COUNT, STARTED] = [0, 1, 2, 3, 4, 5];  // of `phase`
const N_COUNTS = 6;
const NONE = -1, UNKNOWN = -1.0;
const LARGEST = 1 - 2 ** -53;  // of a reflection coefficient

/** Return white noise of the kernel's distribution: a sum of four, of unit variance, within 3.47 deviations. */
const anyNoise = () => (Math.random() + Math.random() + Math.random() + Math.random() - 2) * Math.sqrt(3);

/** Find the node below x, the one above, and the share of the latter, in `found`; held at both ends. */
function cell(bank, at, n, x, found) {
  if (n === 1 || x <= bank[at]) return found.fill(0);
  found[2] = 0;
  if (x >= bank[at + n - 1]) return found.fill(n - 1, 0, 2);
  let i = 0;
  while (x >= bank[at + i + 1]) i++;
  found[0] = i;
  found[1] = i + 1;
  found[2] = (x - bank[at + i]) / (bank[at + i + 1] - bank[at + i]);
  return found;
}

/** Pass a sample of the noise through the lattice whose k, c and states begin at these places; return its state b_0. */
function lattice(state, x, p, k, c, b) {
  for (let m = p - 1; m >= 0; m--) {  // f_{m-1} = c f_m - k b_{m-1},  b_m = k f_m + c b_{m-1}
    const up = state[k + m] * x + state[c + m] * state[b + m];
    x = state[c + m] * x - state[k + m] * state[b + m];
    state[b + m + 1] = up;
  }
  return state[b] = x;
}

/** Return x and the oscillators whose amplitudes, steps and phases begin at these places; move the phases. */
function oscillators(state, x, n, amplitude, step, phase) {
  for (let j = 0; j < n; j++) {
    if (state[step + j] < Math.PI) x += state[amplitude + j] * Math.cos(state[phase + j]);
    const angle = state[phase + j] + state[step + j];
    state[phase + j] = angle > Math.PI ? angle - 2 * Math.PI : angle;
  }
  return x;
}

/** Return { touch(contact, model), step(contact, vx, vy, force) } for a scene's `bank` and `index`. */
function createRenderer(bank, index, nContacts, draw = anyNoise) {
  const of = (model, column) => index[model * N_INDEX + column];
  let columns = 0;
  for (let m = 0; m < index.length / N_INDEX; m++) columns = Math.max(columns, of(m, ORDER) + of(m, N_LINES));
  const span = columns + 1, width = 3 * span, nState = VOICES + 2 * width;
  const states = Array.from({ length: nContacts }, () => new Float64Array(nState));
  const phases = Array.from({ length: nContacts }, () => new Int32Array(N_COUNTS).fill(NONE, 0, 3));
  const inSpeed = new Float64Array(3), inForce = new Float64Array(3);

  function start(state, contact, model, voice) {
    const p = of(model, ORDER), n = of(model, N_LINES);
    for (let m = 0; m <= p; m++) state[voice + m] = draw(contact);
    for (let m = p + 1; m < p + 1 + n; m++) state[voice + m] = draw(contact) * (Math.PI / 3.5);
    state[voice + 2 * span + p + n] = UNKNOWN;
  }

  function sound(state, contact, model, voice, renew) {
    const p = of(model, ORDER), n = of(model, N_LINES);
    if (p + n === 0) return 0;
    const v = state[SPEED], f = state[FORCE];
    const nF = of(model, N_FORCES);
    const [i0, i1, wv] = cell(bank, of(model, AT_SPEEDS), of(model, N_SPEEDS), Math.log(v), inSpeed);
    const [j0, j1, wf] = cell(bank, of(model, AT_FORCES), nF, Math.log(f), inForce);
    const n00 = i0 * nF + j0, n01 = i0 * nF + j1, n10 = i1 * nF + j0, n11 = i1 * nF + j1;
    const w00 = (1 - wv) * (1 - wf), w01 = (1 - wv) * wf, w10 = wv * (1 - wf), w11 = wv * wf;
    const b = voice, k = voice + span, c = voice + 2 * span;
    if (renew) {
      const at = of(model, AT_ROWS), row = p + n;
      const a00 = at + n00 * row, a01 = at + n01 * row, a10 = at + n10 * row, a11 = at + n11 * row;
      let share = 1;
      for (let m = 0; m < row; m++) {
        let x = w00 * bank[a00 + m] + w01 * bank[a01 + m] + w10 * bank[a10 + m] + w11 * bank[a11 + m];
        if (m < p) {
          x = Math.min(Math.max(x, -LARGEST), LARGEST);
          state[c + m] = Math.sqrt((1 - x) * (1 + x));
        } else {
          const course = of(model, AT_COURSE) + m - p;
          const hz = bank[course] + bank[course + n] * v;
          state[c + m] = Math.min(hz * bank[RADIANS], Math.PI);
          share -= 0.5 * x * x;
        }
        state[k + m] = x;
      }
      state[k + row] = Math.sqrt(Math.max(share, 0));
    }
    let x = 0;
    if (p > 0) x = lattice(state, draw(contact), p, k, c, b) * state[k + p + n];
    x = oscillators(state, x, n, k + p, c + p, b + p + 1);
    const at = of(model, AT_POWER), bounds = of(model, AT_BOUNDS);
    const lnPower = w00 * bank[at + n00] + w01 * bank[at + n01] + w10 * bank[at + n10] + w11 * bank[at + n11];
    const loud = Math.min(v / (bank[STILL] * bank[bounds]), 1) * Math.min(f / bank[bounds + 1], 1);
    let heard = state[c + p + n];
    heard = heard < 0 ? loud : heard + bank[GLIDE] * (loud - heard);
    state[c + p + n] = heard > 1e-30 ? heard : 0;
    const limit = bank[bounds + 2];
    return Math.min(Math.max(heard * Math.exp(0.5 * lnPower) * x, -limit), limit);
  }

  function follow(state, phase, vx, vy, force) {
    const v = Math.sqrt(vx * vx + vy * vy), f = Math.max(force, 0);
    const share = phase[STARTED] ? bank[GLIDE] : 1;
    phase[STARTED] = 1;
    state[SPEED] += share * (v - state[SPEED]);
    state[FORCE] += share * (f - state[FORCE]);
    if (state[SPEED] < 1e-30) state[SPEED] = 0;
    if (state[FORCE] < 1e-30) state[FORCE] = 0;
  }

  function changeOver(state, phase, contact) {
    if (phase[FADED] !== 0 || phase[WANTED] === phase[MODEL]) return;
    state.copyWithin(VOICES + width, VOICES, VOICES + width);
    phase[OTHER] = phase[MODEL];
    phase[MODEL] = phase[WANTED];
    phase[FADED] = 1;
    phase[COUNT] = 0;
    if (phase[MODEL] >= 0) start(state, contact, phase[MODEL], VOICES);
  }

  function step(contact, vx, vy, force) {
    const state = states[contact], phase = phases[contact];
    changeOver(state, phase, contact);
    const model = phase[MODEL], other = phase[OTHER], faded = phase[FADED];
    if (model < 0 && other < 0) {
      phase[STARTED] = 0;
      phase[FADED] = 0;
      return 0;
    }
    follow(state, phase, vx, vy, force);
    const renew = phase[COUNT] === 0;
    phase[COUNT] += 1;
    if (phase[COUNT] >= bank[HOP]) phase[COUNT] = 0;
    let x = 0;
    if (model >= 0) x = sound(state, contact, model, VOICES, renew);
    if (faded > 0) {
      const angle = 0.5 * Math.PI * faded / bank[FADE];
      x *= Math.sin(angle);
      if (other >= 0) x += Math.cos(angle) * sound(state, contact, other, VOICES + width, renew);
      phase[FADED] = faded + 1;
      if (faded + 1 >= bank[FADE]) {
        phase[FADED] = 0;
        phase[OTHER] = NONE;
      }
    }
    return Math.min(Math.max(x, -bank[OUTPUT]), bank[OUTPUT]);
  }

  const touch = (contact, model) => { phases[contact][WANTED] = model; };
  return { touch, step };
}
