"use strict";
// Audio worklet: equalisation, resampling to the rate of the loudspeaker, taps, and a limiter. It is appended to kernels.js.

const HALF_LENGTH = 16, N_PHASES = 128;  // filter taps on each side, and number of filter phases between two samples
const CEILING = 0.5;  // largest output sample, relative to full scale
const MAX_MODES = 32;  // largest number of simultaneous decaying modes of taps

/** Return a function next() that resamples `source` with a linear-phase filter; `ratio` = old rate / new rate <= 1. */
function createInterpolator(source, ratio) {
  const n = 2 * HALF_LENGTH, table = new Float64Array((N_PHASES + 1) * n), ring = new Float64Array(2 * n);
  const bessel = (x) => {
    let sum = 1, term = 1;
    for (let i = 1; i < 30; i++) sum += (term *= (x / (2 * i)) ** 2);
    return sum;
  };
  for (let phase = 0; phase <= N_PHASES; phase++) {
    for (let i = 0; i < n; i++) {
      const t = i - HALF_LENGTH + 1 - phase / N_PHASES, w = Math.max(0, 1 - (t / HALF_LENGTH) ** 2);
      const kaiser = bessel(5.7 * Math.sqrt(w)) / bessel(5.7);  // 60 dB stop band
      table[phase * n + i] = (t ? Math.sin(Math.PI * t) / (Math.PI * t) : 1) * kaiser;
    }
  }
  let position = 1, begin = 0;
  return () => {
    for (; position >= 1; position -= 1) {
      ring[begin] = ring[begin + n] = source();
      begin = (begin + 1) % n;
    }
    const phase = Math.floor(position * N_PHASES), w = position * N_PHASES - phase, row = phase * n;
    let sum = 0;
    for (let i = 0; i < n; i++) sum += ((1 - w) * table[row + i] + w * table[row + n + i]) * ring[begin + i];
    position += ratio;
    return sum;
  };
}

/** Return a function next() that filters `source` with the FIR filter `taps`. */
function createFilter(source, taps) {
  const n = taps.length, ring = new Float64Array(2 * n);  // ring[begin + i] is i samples old
  let begin = 0;
  return () => {
    begin = (begin || n) - 1;
    ring[begin] = ring[begin + n] = source();
    let sum = 0;
    for (let i = 0; i < n; i++) sum += taps[i] * ring[begin + i];
    return sum;
  };
}

/** Return a function limit(x): its gain drops at once if x exceeds the ceiling, and recovers within 0.2 s. */
function createLimiter(fs, ceiling = CEILING) {
  const release = Math.exp(-1 / (0.07 * fs));
  let envelope = 0;
  return (x) => {
    envelope = Math.max(Math.abs(x), envelope * release);
    return envelope > ceiling ? x * ceiling / envelope : x;
  };
}

/** Return { strike(modes, velocity), next() }: taps as sums of modes A v exp(-B t) sin(2 pi f t + phase) at `fs`. */
function createTaps(fs) {
  let oscillators = [];
  function strike(modes, velocity) {
    for (const [amplitude, decay, hz, phase] of modes) {
      const r = Math.exp(-decay / fs), angle = 2 * Math.PI * hz / fs, size = amplitude * velocity;
      const oscillator = {
        re: size * Math.cos(phase), im: size * Math.sin(phase), cos: r * Math.cos(angle), sin: r * Math.sin(angle),
      };
      if (hz < fs / 2) oscillators = [...oscillators.slice(1 - MAX_MODES), oscillator];
    }
  }
  function next() {
    let sum = 0, hasEnded = false;
    for (const one of oscillators) {
      sum += one.im;
      const re = one.re * one.cos - one.im * one.sin;
      one.im = one.re * one.sin + one.im * one.cos;
      one.re = re;
      hasEnded ||= Math.abs(re) + Math.abs(one.im) < 1e-9;
    }
    if (hasEnded) oscillators = oscillators.filter((one) => Math.abs(one.re) + Math.abs(one.im) >= 1e-9);
    return sum;
  }
  return { strike, next };
}

/**
 * Audio processor with two outputs: audio (limited), and vibration relative to `fullScale`.
 * Messages: {contact, model, vx, vy, force}; {tap, velocity}; {gain}; {values, offset}, which overwrites part of
 * `bank`. With a `script` {vx, vy, force, model, noise}, contact 0 follows the script sample by sample. At the end,
 * the vibration at the sampling rate of the models is sent back.
 */
function defineProcessor(Base) {
  return class extends Base {
    constructor({ processorOptions: { bank, index, fs, contacts, fullScale, gain, equalizer, script } }) {
      super();
      let n = 0;
      this.renderer = createRenderer(bank, index, contacts, script ? () => script.noise[n++] : randomNoise);
      this.motion = Array.from({ length: contacts }, () => ({ vx: 0, vy: 0, force: 0 }));
      this.taps = createTaps(sampleRate);
      this.limit = createLimiter(sampleRate);
      const filtered = createFilter(() => this.renderSample(), equalizer || [1]);
      this.nextSample = createInterpolator(filtered, fs / sampleRate);
      Object.assign(this, { bank, fullScale, gain, targetGain: gain, script, samples: [], isSilent: true });
      this.port.onmessage = ({ data }) => this.receive(data);
    }

    receive(data) {
      if ("gain" in data) this.targetGain = data.gain;
      if ("values" in data) this.bank.set(data.values, data.offset);
      if ("tap" in data) this.taps.strike(data.tap, data.velocity);
      if ("contact" in data && isValidMotion(data.vx, data.vy, data.force)) {
        this.renderer.touch(data.contact, data.model);
        this.motion[data.contact] = data;
      }
    }

    renderSample() {
      if (this.script) return this.renderScript();
      let sum = 0;
      this.motion.forEach(({ vx, vy, force }, contact) => { sum += this.renderer.step(contact, vx, vy, force); });
      return sum;
    }

    renderScript() {
      const { vx, vy, force, model } = this.script, t = this.samples.length;
      if (t >= vx.length) return 0;
      this.renderer.touch(0, model[t]);
      this.samples.push(this.renderer.step(0, vx[t], vy[t], force[t]));
      if (t === vx.length - 1) this.port.postMessage({ samples: this.samples });
      return this.samples[t];
    }

    process(_, [[audio], [vibration]]) {
      for (let t = 0; t < audio.length; t++) {
        const x = this.nextSample() + this.taps.next();
        this.gain += 0.001 * (this.targetGain - this.gain);
        if (vibration) vibration[t] = x / this.fullScale;
        audio[t] = this.limit(x / this.fullScale * this.gain);
        if (this.isSilent && Math.abs(audio[t]) > 1e-4) {
          this.isSilent = false;
          this.port.postMessage({ startTime: currentTime + t / sampleRate });
        }
      }
      return true;
    }
  };
}

if (typeof registerProcessor === "function") registerProcessor("scene", defineProcessor(AudioWorkletProcessor));
