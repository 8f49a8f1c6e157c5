"""Measure the run time of a baseline for one recording; `feature_speed.py` starts it in its interpreter.

Arguments: the folder that holds `baseline_worker`, a .npy file with the recording, fs in Hz. Each line on the
standard input names a baseline; the answer is a line of JSON. All threads of the process count.
"""

import json
import sys
import time
from typing import Any

import numpy as np


def main() -> None:
    """Answer each line; the first answer for a baseline comes after it has warmed up."""
    sys.path.append(sys.argv[1])
    from baseline_worker.baselines import BASELINES  # type: ignore[import-not-found]

    signal, fs = np.load(sys.argv[2])[np.newaxis], float(sys.argv[3])
    ready: dict[str, Any] = {}
    for line in sys.stdin:
        name = line.strip()
        if name not in ready:
            ready[name] = BASELINES[name].make(fs, 0).fit([signal, signal])
            ready[name].transform([signal])
        start = time.process_time()
        table = ready[name].transform([signal])
        seconds = time.process_time() - start
        print(json.dumps({"seconds": seconds, "n_columns": int(np.size(table))}), flush=True)


if __name__ == "__main__":
    main()
