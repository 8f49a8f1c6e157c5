"""
Prony's method and the matrix pencil
====================================

Model a decaying vibration as the impulse response of a filter [guruswamy2011, section IV-A]. Prony's method
can return unstable poles; the matrix pencil never does.
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

fs = 10_000
t = np.arange(300) / fs
clean = 3 * np.exp(-80 * t) * np.cos(2 * np.pi * 420 * t) + np.exp(-150 * t) * np.cos(
    2 * np.pi * 1100 * t + 1
)
x = clean + 0.05 * np.random.default_rng(0).standard_normal(t.size)

# %%
# Prony's method increases the order until the error is below the resolution, so it also models the noise.

prony = tx.vibration.fit_prony(x, resolution=0.08)
modes = tx.vibration.fit_matrix_pencil(x, fs)
print(f"Prony: order {prony.order}, stable: {prony.is_stable}")
for f, b, a in zip(modes.frequency_hz, modes.decay_per_s, modes.amplitude, strict=True):
    print(f"pencil: {f:.0f} Hz, decay {b:.0f} 1/s, amplitude {a:.2f}")

# %%
# Both models fit the recording, but with different numbers of poles.

figure, (signal_axis, pole_axis) = plt.subplots(1, 2, figsize=(10, 4))
signal_axis.plot(1e3 * t, x, ".", color="0.7", label="recorded")
signal_axis.plot(1e3 * t, prony.synthesize(t.size), color="C1", label="Prony")
signal_axis.plot(1e3 * t, modes.synthesize(t.size, fs), color="C0", label="matrix pencil")
signal_axis.set_xlabel("ms")
signal_axis.set_ylabel("m/s²")
signal_axis.legend()

z = np.exp((-modes.decay_per_s + 2j * np.pi * modes.frequency_hz) / fs)
pole_axis.add_patch(plt.Circle((0, 0), 1, fill=False, color="0.6"))
for poles, look in ((np.roots(prony.a), "C1."), (np.append(z, z.conj()), "C0x")):
    pole_axis.plot(poles.real, poles.imag, look)
pole_axis.set_xticks([-1, 0, 1])
pole_axis.set_yticks([-1, 0, 1])
pole_axis.set_title("poles in the unit circle")
pole_axis.set_aspect("equal")
plt.show()
