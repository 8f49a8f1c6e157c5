"""reports/studies/stream.md from reports/studies/stream.json."""

from typing import Any


def markdown(result: dict[str, Any]) -> str:
    """Return the report of the parts that there are."""
    lines = ["# Listening: speed, equality with batch, accuracy against seconds", ""]
    if "speed" in result:
        lines += _speed(result["speed"])
    if "memory" in result:
        lines += _memory(result["memory"])
    if found := [result[k] for k in ("equality-simulated", "equality-biotac20") if k in result]:
        lines += _equality(found)
    if "accuracy" in result:
        lines += _accuracy(result["accuracy"])
    some = next(iter(result.values()))
    stated = ", ".join(f"{name} {version}" for name, version in some["versions"].items())
    return "\n".join([*lines, f"Seed {some['seed']}. Versions: {stated}.", ""])


def _speed(s: dict[str, Any]) -> list[str]:
    some = next(iter(s["models"].values()))
    return [
        "## Speed",
        "",
        f"{some['n_blocks']:,} blocks of 25 ms of `{s['dataset']}`, {some['n_axes']} axes at {some['fs']:g} "
        f"Hz, one thread; windows of {some['window_s']:g} s, pipelines pruned to the columns that "
        "a selection under a budget left. Wall time of each block, the least of several rounds.",
        "",
        "| pipeline | columns | one window right % | a window every, s | blocks with an answer % | p50 ms | "
        "p90 | p99 | p99.9 | mean | without an answer | with one | times real time | one rfft, ms |",
        "|---|" + 13 * "---:|",
        *(
            f"| {name} | {t['columns']} | {100 * t['accuracy_of_a_window']:.1f} | {t['hop_s']:g} | "
            f"{100 * t['with_answers']:.1f} | {t['p50']:.3f} | "
            f"{t['p90']:.3f} | {t['p99']:.3f} | {t['p99.9']:.3f} | {t['mean']:.3f} | {t['quiet']:.3f} | "
            f"{t['busy']:.3f} | {t['times_real_time']:.0f} | {t['reference_ms']:.2f} |"
            for name, t in s["models"].items()
        ),
        "",
        "One `np.fft.rfft` of 250,000 samples (the last column, in the same run) takes "
        f"2.6 ms when nothing else runs; the load average was {some['load']:.1f} on two cores.",
        "",
    ]


def _memory(m: dict[str, Any]) -> list[str]:
    held = m["memory_mb"]
    return [
        "## Memory",
        "",
        f"{m['seconds'] / 3600:g} simulated hour: the process held {', '.join(f'{mb:.1f}' for mb in held)} "
        f"MB at twelfths of it, {held[-1] - held[0]:+.1f} MB from the first to the last; the rings take "
        f"{m['rings_mb']:.2f} MB. CPU time was 1/{m['cpu_times_real_time']:.0f} of the hour (one rfft: "
        f"{m['reference_ms']:.2f} ms).",
        "",
    ]


def _equality(found: list[dict[str, Any]]) -> list[str]:
    return [
        "## Stream equals batch",
        "",
        "Streams in blocks of 1, 7, 250 and 4096 samples must give the same events, windows and answers bit "
        "by bit; each answer is compared with the model's for the same samples cut from the recording.",
        "",
        "| dataset | recordings | with answers | windows | streams that differ by block | different labels | "
        "largest difference of a probability |",
        "|---|---:|---:|---:|---:|---:|---:|",
        *(
            f"| {f['dataset']} | {f['n_recordings']} | {f['n_recordings_with_answers']} | {f['n_windows']} | "
            f"{f['n_streams_that_differ_by_block']} | {f['n_different_labels']} | "
            f"{f['largest_difference_of_probability']:.1e} |"
            for f in found
        ),
        "",
        "Where a dataset card removes the resting level, a stream removes the median of each window instead: "
        "rounding differs, labels do not.",
        "",
    ]


def _accuracy(a: dict[str, Any]) -> list[str]:
    sequential, majority = a["curves"]["sequential"], a["curves"]["majority"]
    stopped, first = a["stopped"], a["first_answer_s"]
    took = first["and milliseconds of computing, 99 %"]
    return [
        "## Accuracy against seconds",
        "",
        f"{a['n_recordings']} recordings of `{a['dataset']}`, trained on {a['trained_on']}; windows of "
        f"{a['window_s']:g} s every {a['hop_s']:g} s. The first answer is there {first['of signal']:.3f} s "
        f"after contact, and {took:.1f} ms of computing (99 % of them). The beginning of a slide is unlike "
        "the rest: all windows of its first 0.9 s train, then every fourth. With windows every half second "
        "from the start on, the first one was learnt and the next ones were not: 84 % were right after "
        "0.25 s, 76 % after 0.5 s.",
        "",
        "| seconds | sequential % [95 %] | calibration error | majority % [95 %] | calibration error |",
        "|---:|---|---:|---|---:|",
        *(
            f"| {s['seconds']:g} | {_interval(s)} | {s['calibration_error']:.3f} | {_interval(m)} | "
            f"{m['calibration_error']:.3f} |"
            for s, m in zip(sequential, majority, strict=True)
        ),
        "",
        f"Stopped when sure (95 %): {100 * stopped['accuracy']:.1f} % right after {stopped['median_s']:.2f} "
        f"s (median; {stopped['p90_s']:.2f} s for nine in ten), {100 * stopped['share_sure']:.0f} % became "
        "sure.",
        "",
        "Calibration error of the sequential evidence by the weight of a second of touch against an "
        "independent one:",
        "",
        "| weight | " + " | ".join(f"{s['seconds']:g} s" for s in sequential) + " |",
        "|---:|" + "---:|" * len(sequential),
        *(
            f"| {d} | " + " | ".join(f"{e:.3f}" for e in errors) + " |"
            for d, errors in a["discounts"].items()
        ),
        "",
    ]


def _interval(point: dict[str, Any]) -> str:
    return f"{100 * point['accuracy']:.1f} [{100 * point['low']:.1f}, {100 * point['high']:.1f}]"
