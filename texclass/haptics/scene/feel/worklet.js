"use strict";
// From the models' rate to that of the loudspeaker, taps, and a limit on loudness. Behind kernels.js in one module.

const HALF = 16, PHASES = 128;  // taps on either side of a sample, and tables between two samples
const CEILING = 0.5;  // of full scale: no sample that leaves is larger
const MOST_MODES = 32;  // of taps that still ring

/** Return next(): samples of `source` at `ratio` = its rate / the new one, at most 1, through a linear-phase filter. */
function createInterpolator(source, ratio) {
  const n = 2 * HALF, table = new Float64Array((PHASES + 1) * n), ring = new Float64Array(2 * n);
  const bessel = (x) => {
    let sum = 1, term = 1;
    for (let i = 1; i < 30; i++) sum += (term *= (x / (2 * i)) ** 2);
    return sum;
  };
  for (let phase = 0; phase <= PHASES; phase++) {
    for (let i = 0; i < n; i++) {
      const t = i - HALF + 1 - phase / PHASES, w = Math.max(0, 1 - (t / HALF) ** 2);  // a Kaiser window, 60 dB
      table[phase * n + i] = (t ? Math.sin(Math.PI * t) / (Math.PI * t) : 1) * bessel(5.7 * Math.sqrt(w)) / bessel(5.7);
    }
  }
  let at = 1, begin = 0;
  return () => {
    for (; at >= 1; at -= 1) {
      ring[begin] = ring[begin + n] = source();
      begin = (begin + 1) % n;
    }
    const phase = Math.floor(at * PHASES), w = at * PHASES - phase, low = phase * n;
    let sum = 0;
    for (let i = 0; i < n; i++) sum += ((1 - w) * table[low + i] + w * table[low + n + i]) * ring[begin + i];
    at += ratio;
    return sum;
  };
}

/** Return limit(x): gain falls at once where x is above the ceiling, and comes back within a fifth of a second. */
function createLimiter(fs, ceiling = CEILING) {
  const release = Math.exp(-1 / (0.07 * fs));
  let most = 0;
  return (x) => {
    most = Math.max(Math.abs(x), most * release);
    return most > ceiling ? x * ceiling / most : x;
  };
}

/** Return { strike(modes, velocity), next() }: taps of modes A v exp(-B t) sin(2 pi f t + phase), at `fs`. */
function createTaps(fs) {
  let ringing = [];
  function strike(modes, velocity) {
    for (const [amplitude, decay, hz, phase] of modes) {
      const r = Math.exp(-decay / fs), angle = 2 * Math.PI * hz / fs, size = amplitude * velocity;
      const turn = { re: size * Math.cos(phase), im: size * Math.sin(phase), cos: r * Math.cos(angle), sin: r * Math.sin(angle) };
      if (hz < fs / 2) ringing = [...ringing.slice(1 - MOST_MODES), turn];
    }
  }
  function next() {
    let sum = 0, ended = false;
    for (const one of ringing) {
      sum += one.im;
      const re = one.re * one.cos - one.im * one.sin;
      one.im = one.re * one.sin + one.im * one.cos;
      one.re = re;
      ended ||= Math.abs(re) + Math.abs(one.im) < 1e-9;
    }
    if (ended) ringing = ringing.filter((one) => Math.abs(one.re) + Math.abs(one.im) >= 1e-9);
    return sum;
  }
  return { strike, next };
}

/**
 * Two outputs: what is heard (limited), and what is felt, in parts of `full`. Messages: {contact, model, vx, vy,
 * force}, {tap, velocity}, {gain}, {part, at} of the bank. With a `script` of {vx, vy, force, model, noise}, sample by sample, contact 0
 * follows it, and its samples at the models' rate are sent back at its end.
 */
function defineProcessor(Base) {
  return class extends Base {
    constructor({ processorOptions: { bank, index, fs, contacts, full, gain, script } }) {
      super();
      let drawn = 0;
      this.renderer = createRenderer(bank, index, contacts, script ? () => script.noise[drawn++] : anyNoise);
      this.motion = Array.from({ length: contacts }, () => ({ vx: 0, vy: 0, force: 0 }));
      this.taps = createTaps(sampleRate);
      this.limit = createLimiter(sampleRate);
      this.sample = createInterpolator(() => this.feel(), fs / sampleRate);
      Object.assign(this, { bank, full, gain, wanted: gain, script, felt: [], silent: true });
      this.port.onmessage = ({ data }) => this.hear(data);
    }

    hear(data) {
      if ("gain" in data) this.wanted = data.gain;
      if ("part" in data) this.bank.set(data.part, data.at);
      if ("tap" in data) this.taps.strike(data.tap, data.velocity);
      if ("contact" in data && [data.vx, data.vy, data.force].every(Number.isFinite)) {
        this.renderer.touch(data.contact, data.model);
        this.motion[data.contact] = data;
      }
    }

    feel() {
      if (this.script) return this.follow();
      let sum = 0;
      this.motion.forEach(({ vx, vy, force }, contact) => { sum += this.renderer.step(contact, vx, vy, force); });
      return sum;
    }

    follow() {
      const { vx, vy, force, model } = this.script, t = this.felt.length;
      if (t >= vx.length) return 0;
      this.renderer.touch(0, model[t]);
      this.felt.push(this.renderer.step(0, vx[t], vy[t], force[t]));
      if (t === vx.length - 1) this.port.postMessage({ felt: this.felt });
      return this.felt[t];
    }

    process(_, [[heard], [felt]]) {
      for (let t = 0; t < heard.length; t++) {
        const x = this.sample() + this.taps.next();
        this.gain += 0.001 * (this.wanted - this.gain);
        if (felt) felt[t] = x / this.full;
        heard[t] = this.limit(x / this.full * this.gain);
        if (this.silent && Math.abs(heard[t]) > 1e-4) {
          this.silent = false;
          this.port.postMessage({ sounded: currentTime + t / sampleRate });
        }
      }
      return true;
    }
  };
}

if (typeof registerProcessor === "function") registerProcessor("feel", defineProcessor(AudioWorkletProcessor));
