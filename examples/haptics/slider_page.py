"""
Sliders for how a surface feels
===============================

A stroked surface becomes a page with a slider for each scale on which it is described: rougher, bumpier,
finer, more regular, harder, stickier. What they make of it is heard at once; a command that the page says
writes it.
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
# `tx.haptics.scene.write_slider_page("sliders.html", texture)` writes this page, and so does
# `texclass texture wood.texture --sliders sliders.html`. Move a slider, or press the surface and stroke it.


class Framed(str):
    def _repr_html_(self):
        return f'<iframe srcdoc="{escape(self)}" title="Sliders" width="100%" height="1100"></iframe>'


Framed(tx.haptics.scene.slider_page(texture, file="wood.texture"))

# %%
# The sliders do what :func:`texclass.haptics.textures.retouch` does: one scale follows, the others stay.

before = tx.haptics.textures.felt_scales(texture)
asked = before["rough"] + np.array([-2.0, -1.0, 1.0, 2.0])
felt = [
    tx.haptics.textures.felt_scales(tx.haptics.textures.retouch(texture, rough=value), seed=5)
    for value in asked
]

figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
for name in ("rough", "bumpy", "fine", "regular"):
    axis.plot(asked, [one[name] for one in felt], "o-" if name == "rough" else "o--", label=name)
axis.set(xlabel="rough, as asked", ylabel="as measured again")
axis.legend()
plt.show()
