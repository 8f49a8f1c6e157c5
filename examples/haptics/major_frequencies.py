"""
Major frequencies
=================

Represent a texture by about a dozen sinusoids that a finger can distinguish [oeztuerk2018, section 3.2].
"""

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

recording = tx.open_dataset("simulated6")[48]
movement = recording.acceleration[slice(*tx.find_phases(recording).movement), 2]
x = movement - movement.mean()
lines = tx.vibration.fit_major_frequencies(x, recording.fs, n_frequencies=13)

# %%
# Plot the spectrum and the selected lines. A line is skipped if it is closer to a stronger line than the beat
# threshold.

f = np.fft.rfftfreq(x.size, 1 / recording.fs)
amplitude = 2 * np.abs(np.fft.rfft(x)) / x.size
figure, axis = plt.subplots(figsize=(8, 3.5))
axis.plot(f, amplitude, color="0.7", linewidth=0.7, label="recorded")
axis.stem(lines.frequency_hz, lines.amplitude, linefmt="C0", markerfmt="C0o", basefmt=" ", label="13 lines")
axis.set_xlim(0, 600)
axis.set_xlabel("Hz")
axis.set_ylabel("m/s²")
axis.legend()
plt.show()

# %%
# Compute the fraction of the signal power that the lines contain:

print(f"{100 * np.sum(lines.amplitude**2 / 2) / np.mean(x**2):.0f} %")
