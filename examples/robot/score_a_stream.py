"""
Score a live stream
===================

How often does a stream miss a contact or report one that is not there, and how long does it take until the
answer is right? `score_stream` plays recordings with known contacts like a live stream and measures this.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import texclass as tx

dataset = tx.open_dataset("simulated6")
model = tx.train(dataset, row="Movement", classifier="lda", window_s=0.8)

# %%
# A drive consists of four recordings, with two seconds of rest after each. In each recording, the tool taps
# the surface three times, and then strokes it. The contacts are the strokes: start and end in seconds since
# the first sample, and the surface.

recordings = [dataset[i] for i in (10, 22, 34, 58)]
fs = recordings[0].fs
parts, rows, n = [], [], 0
for one in recordings:
    first, last = (one.phases or tx.find_phases(one)).movement
    rows.append(((n + first) / fs, (n + last) / fs, one.surface))
    rest = np.resize(one.acceleration[: int(0.2 * fs)], (int(2 * fs), 3))
    parts += [one.acceleration, rest]
    n += len(one.acceleration) + len(rest)
drive = tx.Recording(np.concatenate(parts), fs, "m/s^2", "drive")
intervals = pd.DataFrame(rows, columns=["start_s", "end_s", "surface"])
intervals.round(2)

# %%
# `table` has one row per contact, with delays in seconds since its start.

score = tx.score_stream(model, drive, intervals)
score.table[["surface", "answer", "contact_delay_s", "first_right_s", "right_to_end_s"]].round(2)

# %%
# The confusion over time contains the seconds for each true surface (rows) and each answer at that time.

score.confusion.round(2)

# %%
# Plot the true contacts (above) and the answers of the stream (below). `score.save("score")` writes a report.
# The same from the command line::
#
#     texclass score-stream surfaces.skops drive.csv --intervals intervals.csv -o score

score.plot()
plt.show()
