"""
Classify a live stream
======================

A model classifies the surface while the tool moves. `listen` yields events (tap, contact, lift-off) and
answers as soon as they are available. Samples can arrive in blocks of any size.
"""

import matplotlib.pyplot as plt

import texclass as tx

dataset = tx.open_dataset("simulated6")
model = tx.train(dataset, row="Movement", classifier="lda", window_s=0.8)
recording = dataset[58]

# %%
# Here, the source is a recording. Other sources are standard input (``"-"``) and ROS 2 topics
# (``"ros2:/imu"``).

answers = []
for item in tx.listen(model, recording):
    if isinstance(item, tx.recognition.Event):
        print(f"{item.sample / recording.fs:.3f} s: {item.kind}")
    elif isinstance(item, tx.recognition.WindowAnswer):
        answers.append(item)

# %%
# Plot the probabilities of the contact, which combine the evidence of all its windows so far.

time = [answer.n_received / recording.fs for answer in answers]
figure, (above, below) = plt.subplots(2, sharex=True, figsize=(9, 4.5))
above.plot(
    [i / recording.fs for i in range(recording.n_samples)], recording.acceleration[:, 2], linewidth=0.5
)
above.set_ylabel("m/s²")
for surface in model.surfaces:
    p = [answer.verdict.probabilities[surface] for answer in answers]
    is_true = surface == recording.surface
    below.plot(time, p, "o-", color="C0" if is_true else "0.75", label=surface if is_true else None)
below.set_ylim(0, 1.05)
below.set_ylabel("probability")
below.set_xlabel("time in s")
below.legend()
plt.show()
