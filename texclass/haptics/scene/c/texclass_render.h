/*
 * Render textures of texclass on a device. One header, C99 or C++, no dependencies, no allocation.
 *
 * `texclass convert wood.texture -o wood.h` writes the models of a texture or scene as constants, next to this file:
 *
 *     #include "wood.h"
 *
 *     static double voices[WOOD_VOICES];
 *     static texclass_contact contact;
 *
 *     texclass_start(&contact, &wood_scene, voices, WOOD_SEED);
 *     texclass_touch(&contact, WOOD_OAK);                        // a surface, or TEXCLASS_LIFT
 *     sample = texclass_step(&contact, velocity_x, velocity_y, force);   // once per sampling period
 *
 * Velocities are in mm/s, forces in N, samples in the unit of the texture, at `wood_scene.fs` samples per second. Each
 * finger or tool is one contact, with its own state: `sizeof(texclass_contact)`, at most 1152 bytes, and WOOD_VOICES
 * doubles. Samples equal those of `texclass.haptics.SceneRenderer` up to rounding. Do not compile with -ffast-math,
 * which removes the checks for NaN.
 *
 * Functions and arrays correspond to those of texclass/haptics/scene/render_kernels.py and web/kernels.js.
 */
#ifndef TEXCLASS_RENDER_H
#define TEXCLASS_RENDER_H

#if defined(__FAST_MATH__)
#error "texclass_render.h checks for NaN. Compile without -ffast-math"
#endif

#include <math.h>
#include <stdint.h>
#include <string.h>

#define TEXCLASS_LIFT (-1)          /* surface of a contact that touches nothing */
#define TEXCLASS_MAX_INPUT 1e9      /* largest magnitude of velocity (mm/s) and force (N) */
#define TEXCLASS_MAX_MODES 32       /* largest number of simultaneous decaying modes of taps per contact */
#define TEXCLASS_PI 3.14159265358979323846
#define TEXCLASS_MAX_REFLECTION 0.99999999999999988898   /* 1 - 2^-53 */
#define TEXCLASS_UNSET (-1.0)       /* loudness of a voice before its first sample */

/* Indices of the constants at the beginning of `bank`. */
enum {
  TEXCLASS_SMOOTHING, TEXCLASS_UPDATE_INTERVAL, TEXCLASS_FADE_SAMPLES, TEXCLASS_REST_RATIO,
  TEXCLASS_RADIANS_PER_HZ, TEXCLASS_OUTPUT_LIMIT
};
/* Columns of `index`: sizes of a model, and offsets of its arrays in `bank`. */
enum {
  TEXCLASS_N_LINES, TEXCLASS_ORDER, TEXCLASS_N_SPEEDS, TEXCLASS_N_FORCES, TEXCLASS_SPEED_OFFSET,
  TEXCLASS_FORCE_OFFSET, TEXCLASS_ROW_OFFSET, TEXCLASS_POWER_OFFSET, TEXCLASS_LINE_OFFSET, TEXCLASS_BOUND_OFFSET,
  TEXCLASS_N_COLUMNS
};

/* Models and taps of the surfaces of a file, as written by `texclass convert`. */
typedef struct {
  double fs;                  /* sampling rate in Hz */
  int32_t n_surfaces;         /* number of surfaces */
  int32_t width;              /* largest number of coefficients and lines of a model */
  const double *bank;         /* constants, and arrays of the models */
  const int32_t *index;       /* TEXCLASS_N_COLUMNS numbers per model */
  const int32_t *models;      /* model of each surface */
  const double *tap_modes;    /* amplitude per m/s, decay (1/s), frequency (Hz) and phase (rad) of each mode */
  const int32_t *first_mode;  /* first mode of the tap of each surface, and the number of modes */
} texclass_scene;

/* A decaying mode of a tap: a phasor z, whose imaginary part is the vibration, and its pole p. */
typedef struct {
  double z_re, z_im, p_re, p_im;
} texclass_mode;

/* State of one contact. Call texclass_start before any other function. */
typedef struct {
  const texclass_scene *scene;
  double *voices;             /* two voices of 3 (width + 1) numbers */
  double speed, force;        /* smoothed motion */
  uint64_t noise;             /* state of the random number generator */
  int32_t model, previous, next, fade_count, update_count, has_motion;
  int32_t n_modes;            /* number of decaying modes */
  int32_t n_refused;          /* number of samples with NaN or an input above TEXCLASS_MAX_INPUT */
  texclass_mode modes[TEXCLASS_MAX_MODES];
} texclass_contact;

static inline double texclass_clamp(double x, double low, double high) {
  return x < low ? low : x > high ? high : x;
}

/* Return a sample of unit-variance white noise, at most 3.47: a sum of four 16-bit parts of SplitMix64. */
static inline double texclass_draw_noise(texclass_contact *contact) {
  uint64_t z = contact->noise += UINT64_C(0x9E3779B97F4A7C15);
  z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
  z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
  z ^= z >> 31;
  const uint64_t total = (z >> 48) + (z & 0xFFFF) + ((z >> 16) & 0xFFFF) + ((z >> 32) & 0xFFFF);
  return ((double)total - 2 * 65535.0) / sqrt((65536.0 * 65536.0 - 1) / 3);
}

/* Set the nodes below and above x, and return the weight of the upper node; x is clamped to the nodes. */
static inline double texclass_cell(const double *nodes, int32_t n, double x, int32_t *below, int32_t *above) {
  int32_t i = 0;
  if (n == 1 || x <= nodes[0]) {
    *below = *above = 0;
    return 0;
  }
  if (x >= nodes[n - 1]) {
    *below = *above = n - 1;
    return 0;
  }
  while (x >= nodes[i + 1]) i++;
  *below = i;
  *above = i + 1;
  return (x - nodes[i]) / (nodes[i + 1] - nodes[i]);
}

/* Filter a noise sample with a lattice of order p, given k and c = sqrt(1 - k^2); return the output b_0. */
static inline double texclass_lattice(double x, int32_t p, const double *k, const double *c, double *b) {
  for (int32_t m = p - 1; m >= 0; m--) {
    const double updated = k[m] * x + c[m] * b[m];
    x = c[m] * x - k[m] * b[m];
    b[m + 1] = updated;
  }
  b[0] = x;
  return x;
}

/* Return x plus n oscillators, and advance their phases; lines with a phase step of pi are silent. */
static inline double texclass_oscillators(double x, int32_t n, const double *amplitude, const double *step,
                                          double *phase) {
  for (int32_t j = 0; j < n; j++) {
    if (step[j] < TEXCLASS_PI) x += amplitude[j] * cos(phase[j]);
    const double angle = phase[j] + step[j];
    phase[j] = angle > TEXCLASS_PI ? angle - 2 * TEXCLASS_PI : angle;
  }
  return x;
}

/* Initialize a voice in its stationary state. */
static inline void texclass_start_voice(texclass_contact *contact, int32_t model, double *voice) {
  const int32_t *layout = contact->scene->index + model * TEXCLASS_N_COLUMNS;
  const int32_t p = layout[TEXCLASS_ORDER], n = layout[TEXCLASS_N_LINES], span = contact->scene->width + 1;
  for (int32_t m = 0; m <= p; m++) voice[m] = texclass_draw_noise(contact);
  for (int32_t m = p + 1; m < p + 1 + n; m++) voice[m] = texclass_draw_noise(contact) * (TEXCLASS_PI / 3.5);
  voice[2 * span + p + n] = TEXCLASS_UNSET;
}

/* Return the next sample of one voice: lattice state and phases b, coefficients k, and c with the loudness. */
static inline double texclass_render_voice(texclass_contact *contact, int32_t model, double *voice, int update) {
  const double *bank = contact->scene->bank;
  const int32_t *layout = contact->scene->index + model * TEXCLASS_N_COLUMNS;
  const int32_t p = layout[TEXCLASS_ORDER], n = layout[TEXCLASS_N_LINES], width = p + n;
  const int32_t span = contact->scene->width + 1;
  const int32_t n_forces = layout[TEXCLASS_N_FORCES];
  double *b = voice, *k = voice + span, *c = voice + 2 * span;
  const double *bounds = bank + layout[TEXCLASS_BOUND_OFFSET];
  const double *ln_powers = bank + layout[TEXCLASS_POWER_OFFSET];
  const double *lines = bank + layout[TEXCLASS_LINE_OFFSET];
  const double v = contact->speed, f = contact->force;
  int32_t i0, i1, j0, j1;
  double x = 0;
  if (width == 0) return 0;
  const double wv =
      texclass_cell(bank + layout[TEXCLASS_SPEED_OFFSET], layout[TEXCLASS_N_SPEEDS], log(v), &i0, &i1);
  const double wf = texclass_cell(bank + layout[TEXCLASS_FORCE_OFFSET], n_forces, log(f), &j0, &j1);
  const int32_t n00 = i0 * n_forces + j0, n01 = i0 * n_forces + j1;
  const int32_t n10 = i1 * n_forces + j0, n11 = i1 * n_forces + j1;
  const double w00 = (1 - wv) * (1 - wf), w01 = (1 - wv) * wf, w10 = wv * (1 - wf), w11 = wv * wf;
  if (update) {
    const double *rows = bank + layout[TEXCLASS_ROW_OFFSET];
    const double *a00 = rows + n00 * width, *a01 = rows + n01 * width;
    const double *a10 = rows + n10 * width, *a11 = rows + n11 * width;
    double noise_share = 1;
    for (int32_t m = 0; m < width; m++) {
      double a = w00 * a00[m] + w01 * a01[m] + w10 * a10[m] + w11 * a11[m];
      if (m < p) {
        a = texclass_clamp(a, -TEXCLASS_MAX_REFLECTION, TEXCLASS_MAX_REFLECTION);
        c[m] = sqrt((1 - a) * (1 + a));
      } else {
        const double hz = lines[m - p] + lines[m - p + n] * v, step = hz * bank[TEXCLASS_RADIANS_PER_HZ];
        c[m] = step < TEXCLASS_PI ? step : TEXCLASS_PI;
        noise_share -= 0.5 * a * a;
      }
      k[m] = a;
    }
    k[width] = sqrt(noise_share > 0 ? noise_share : 0);
  }
  if (p > 0) x = texclass_lattice(texclass_draw_noise(contact), p, k, c, b) * k[width];
  x = texclass_oscillators(x, n, k + p, c + p, b + p + 1);
  const double ln_power = w00 * ln_powers[n00] + w01 * ln_powers[n01] + w10 * ln_powers[n10] + w11 * ln_powers[n11];
  const double slow = v / (bank[TEXCLASS_REST_RATIO] * bounds[0]), light = f / bounds[1];
  const double target = (slow < 1 ? slow : 1) * (light < 1 ? light : 1);
  double loudness = c[width];
  loudness = loudness < 0 ? target : loudness + bank[TEXCLASS_SMOOTHING] * (target - loudness);
  c[width] = loudness > 1e-30 ? loudness : 0;
  return texclass_clamp(loudness * exp(0.5 * ln_power) * x, -bounds[2], bounds[2]);
}

/* Move the smoothed speed and force one sample towards the input. */
static inline void texclass_smooth_motion(texclass_contact *contact, double vx, double vy, double force) {
  const double v = sqrt(vx * vx + vy * vy), f = force > 0 ? force : 0;
  const double smoothing = contact->has_motion ? contact->scene->bank[TEXCLASS_SMOOTHING] : 1;
  contact->has_motion = 1;
  contact->speed += smoothing * (v - contact->speed);
  contact->force += smoothing * (f - contact->force);
  if (contact->speed < 1e-30) contact->speed = 0; /* avoids subnormal numbers, which are slow */
  if (contact->force < 1e-30) contact->force = 0;
}

/* Start the crossfade to the requested model, unless another crossfade is in progress. */
static inline void texclass_start_crossfade(texclass_contact *contact) {
  const int32_t n = 3 * (contact->scene->width + 1); /* size of a voice */
  if (contact->fade_count != 0 || contact->next == contact->model) return;
  memcpy(contact->voices + n, contact->voices, (size_t)n * sizeof(double));
  contact->previous = contact->model;
  contact->model = contact->next;
  contact->fade_count = 1;
  contact->update_count = 0;
  if (contact->model >= 0) texclass_start_voice(contact, contact->model, contact->voices);
}

/* Return the next sample of the texture under the contact. */
static inline double texclass_render_stroke(texclass_contact *contact, double vx, double vy, double force) {
  const double *bank = contact->scene->bank;
  double x = 0;
  texclass_start_crossfade(contact);
  if (contact->model < 0 && contact->previous < 0) {
    contact->has_motion = 0;
    contact->fade_count = 0;
    return 0;
  }
  texclass_smooth_motion(contact, vx, vy, force);
  const int update = contact->update_count == 0;
  contact->update_count += 1;
  if (contact->update_count >= bank[TEXCLASS_UPDATE_INTERVAL]) contact->update_count = 0;
  if (contact->model >= 0) x = texclass_render_voice(contact, contact->model, contact->voices, update);
  if (contact->fade_count > 0) { /* equal-power crossfade: sin^2 + cos^2 = 1 */
    const double angle = 0.5 * TEXCLASS_PI * contact->fade_count / bank[TEXCLASS_FADE_SAMPLES];
    double *voice = contact->voices + 3 * (contact->scene->width + 1);
    x *= sin(angle);
    if (contact->previous >= 0) {
      x += cos(angle) * texclass_render_voice(contact, contact->previous, voice, update);
    }
    contact->fade_count += 1;
    if (contact->fade_count >= bank[TEXCLASS_FADE_SAMPLES]) {
      contact->fade_count = 0;
      contact->previous = TEXCLASS_LIFT;
    }
  }
  return texclass_clamp(x, -bank[TEXCLASS_OUTPUT_LIMIT], bank[TEXCLASS_OUTPUT_LIMIT]);
}

/* Return the sum of the modes of taps, and advance them; modes that have decayed are removed. */
static inline double texclass_render_taps(texclass_contact *contact) {
  double sum = 0;
  int32_t n_left = 0;
  for (int32_t i = 0; i < contact->n_modes; i++) {
    texclass_mode mode = contact->modes[i];
    sum += mode.z_im;
    const double re = mode.z_re * mode.p_re - mode.z_im * mode.p_im;
    mode.z_im = mode.z_re * mode.p_im + mode.z_im * mode.p_re;
    mode.z_re = re;
    if (fabs(mode.z_re) + fabs(mode.z_im) >= 1e-9) contact->modes[n_left++] = mode;
  }
  contact->n_modes = n_left;
  return sum;
}

/* Start a contact that touches nothing. `voices` are the doubles of its voices; `seed` selects its noise. */
static inline void texclass_start(texclass_contact *contact, const texclass_scene *scene, double *voices,
                                  uint64_t seed) {
  memset(contact, 0, sizeof *contact);
  memset(voices, 0, (size_t)(6 * (scene->width + 1)) * sizeof(double));
  contact->scene = scene;
  contact->voices = voices;
  contact->noise = seed;
  contact->model = contact->previous = contact->next = TEXCLASS_LIFT;
}

/* Move a contact to another surface from the next sample on, or end it (TEXCLASS_LIFT, or any invalid number). */
static inline void texclass_touch(texclass_contact *contact, int32_t surface) {
  const int is_surface = surface >= 0 && surface < contact->scene->n_surfaces;
  contact->next = is_surface ? contact->scene->models[surface] : TEXCLASS_LIFT;
}

/* Strike a surface at an impact velocity in m/s. A surface without a measured tap stays silent. */
static inline void texclass_tap(texclass_contact *contact, int32_t surface, double velocity) {
  const texclass_scene *scene = contact->scene;
  if (surface < 0 || surface >= scene->n_surfaces || !(fabs(velocity) <= TEXCLASS_MAX_INPUT)) return;
  for (int32_t i = scene->first_mode[surface]; i < scene->first_mode[surface + 1]; i++) {
    const double *row = scene->tap_modes + 4 * i;
    const double r = exp(-row[1] / scene->fs), angle = 2 * TEXCLASS_PI * row[2] / scene->fs;
    const texclass_mode mode = {row[0] * velocity * cos(row[3]), row[0] * velocity * sin(row[3]), r * cos(angle),
                                r * sin(angle)};
    if (row[2] >= scene->fs / 2) continue;
    if (contact->n_modes == TEXCLASS_MAX_MODES) { /* the oldest mode ends */
      memmove(contact->modes, contact->modes + 1, (TEXCLASS_MAX_MODES - 1) * sizeof(texclass_mode));
      contact->n_modes -= 1;
    }
    contact->modes[contact->n_modes++] = mode;
  }
}

/*
 * Return the next sample of a contact, from its velocity in mm/s and force in N. NaN, and inputs above
 * TEXCLASS_MAX_INPUT, count as rest, so that the output fades out; `n_refused` counts them.
 */
static inline double texclass_step(texclass_contact *contact, double vx, double vy, double force) {
  const double limit = contact->scene->bank[TEXCLASS_OUTPUT_LIMIT];
  if (!(fabs(vx) <= TEXCLASS_MAX_INPUT && fabs(vy) <= TEXCLASS_MAX_INPUT && fabs(force) <= TEXCLASS_MAX_INPUT)) {
    contact->n_refused += contact->n_refused < INT32_MAX;
    vx = vy = force = 0;
  }
  const double x = texclass_render_stroke(contact, vx, vy, force);
  return texclass_clamp(x + texclass_render_taps(contact), -limit, limit);
}

/* Render n samples to `out`. The samples are identical to those of n calls of texclass_step. */
static inline void texclass_process(texclass_contact *contact, size_t n, const double *vx, const double *vy,
                                    const double *force, double *out) {
  for (size_t t = 0; t < n; t++) out[t] = texclass_step(contact, vx[t], vy[t], force[t]);
}

#endif
