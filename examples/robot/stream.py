"""
A stream
========

The same model listens while the tool moves. Events (a tap, a contact, lift-off) and answers come as soon as
they are known, sample by sample or in blocks of any size.
"""

import matplotlib.pyplot as plt

import texclass as tx

dataset = tx.open_dataset("simulated6")
model = tx.train(dataset, row="Movement", classifier="lda", touch_s=0.8)
recording = dataset[58]

# %%
# A recording stands in for the live source here; ``"-"`` is standard input, ``"ros2:/imu"`` a topic.

answers = []
for told in tx.listen(model, recording):
    if isinstance(told, tx.recognition.Event):
        print(f"{told.sample / recording.fs:.3f} s: {told.kind}")
    elif isinstance(told, tx.recognition.WindowAnswer):
        answers.append(told)

# %%
# Each window is answered by itself; the evidence of a contact adds up.

time = [answer.known / recording.fs for answer in answers]
figure, (above, below) = plt.subplots(2, sharex=True, figsize=(9, 4.5))
above.plot(
    [i / recording.fs for i in range(recording.n_samples)], recording.acceleration[:, 2], linewidth=0.5
)
above.set_ylabel("m/s²")
for surface in model.materials:
    p = [answer.verdict.probabilities[surface] for answer in answers]
    right = surface == recording.material
    below.plot(time, p, "o-", color="C0" if right else "0.75", label=surface if right else None)
below.set_ylim(0, 1.05)
below.set_ylabel("probability")
below.set_xlabel("time in s")
below.legend()
plt.show()
