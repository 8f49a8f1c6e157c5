"""
Compensate the response of a device
===================================

An actuator with a resonance plays some frequencies much stronger than others. The inverse of its measured
response, limited in boost, is applied before the vibration is written. The command is
``texclass convert wood.texture -o wood.hjif --device response.csv``.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy import signal

import texclass as tx
from texclass.haptics import exchange

recording = tx.open_dataset("simulated6")[48]
texture = tx.haptics.textures.pack(recording, 128)
rendition = exchange.play_texture(texture, seconds=4.0)

# %%
# The response of a resonant actuator: weak below 150 Hz, 12 dB too strong at 150 Hz. ``read_response`` reads
# such values from a CSV file with the columns ``frequency`` and ``gain`` or ``gain_db``.

hz = np.geomspace(20, 500, 100)
ratio = hz / 150
gain = ratio**2 / np.abs(1 - ratio**2 + 0.25j * ratio)
equalizer = exchange.Equalizer(hz, gain, max_boost_db=30.0)
equalized = exchange.equalize(rendition, equalizer)
for topic in ("device", "headroom"):
    print(f"{topic}: {equalized.losses[topic]}")

# %%
# Compare the vibration of the texture with what the device plays, with and without equalisation. Where the
# boost is limited, the device stays too weak.

figure, axis = plt.subplots(figsize=(8, 4))
for label, x, is_played in (
    ("texture", rendition.samples, False),
    ("device, not equalised", rendition.samples, True),
    ("device, equalised", equalized.samples, True),
):
    frequency, power = signal.welch(x, rendition.fs, nperseg=round(rendition.fs / 8))
    played = power * equalizer.response(frequency) ** (2 * is_played)
    axis.plot(frequency[2:], 10 * np.log10(played[2:]), label=label)
axis.set(xscale="log", xlim=(20, 500), xlabel="Hz", ylabel="dB re 1 (m/s²)²/Hz")
axis.legend()
plt.show()
