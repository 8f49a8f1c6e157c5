"""
Sliders for how a surface feels
===============================

Write a page with one slider for each perceptual scale: rough, bumpy, fine, regular, hard, sticky. Each change
is audible at once, and the page shows the command that writes the changed texture.
"""

from html import escape

import matplotlib.pyplot as plt
import numpy as np

import texclass as tx

surface = tx.simulate.surface_catalogue(6, seed=6)[2]
operator = tx.simulate.operator_catalogue(4, seed=6)[1]
recording = tx.simulate.record_freehand(surface, operator, duration_s=6.0, fs=2000, seed=30)
texture = tx.haptics.textures.pack(recording, 128, name="wood")

# %%
# Write the page with `tx.haptics.scene.write_slider_page("sliders.html", texture)` or
# `texclass texture wood.texture --sliders sliders.html`. Move a slider, or press the surface and stroke it.


class Framed(str):
    def _repr_html_(self):
        return f'<iframe srcdoc="{escape(self)}" title="Sliders" width="100%" height="1100"></iframe>'


Framed(tx.haptics.scene.slider_page(texture, file="wood.texture"))

# %%
# The models behind the sliders are computed with :func:`texclass.haptics.textures.retouch`, which changes one
# scale and keeps the values of the other scales. Measure all scales for several targets of one scale:

original = tx.haptics.textures.measure_scales(texture)
targets = original["rough"] + np.array([-3.0, -2.0, -1.0, 0.5])
measured = [
    tx.haptics.textures.measure_scales(tx.haptics.textures.retouch(texture, rough=value), seed=5)
    for value in targets
]

figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
for name in ("rough", "bumpy", "fine", "regular"):
    axis.plot(targets, [scales[name] for scales in measured], "o-" if name == "rough" else "o--", label=name)
axis.set(xlabel="rough, target", ylabel="measured")
axis.legend()
plt.show()
