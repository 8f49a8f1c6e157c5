"""A minute of ROS 2 messages between two processes over loopback, at 1 and 10 kHz: what is lost, how late.

Run `python tests/benchmarks/dds_minute.py` from the project's root (four minutes). Writes
`reports/studies/dds.md` and `.json`. The reference is a bare UDP socket with datagrams of the same size,
sent by the same process in the same run.
"""

import argparse
import json
import os
import platform
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from texclass.provenance import versions
from texclass.recognition import topic_blocks

ROOT = Path(__file__).resolve().parents[2]
CHILD = ROOT / "tests" / "recognition" / "sources" / "dds_child.py"
RATES_HZ = (1000, 10_000)
LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
)


def over_dds(fs: float, seconds: float) -> dict[str, float]:
    """Publish in another process, hear it as `texclass stream` does, and compare."""
    child = _child("imu", f"/minute{fs}", fs, seconds, 0)
    source = topic_blocks(f"/minute{fs}", fs=fs, end_s=2.0)
    busy = time.process_time()
    heard, late, flags = [], [], set()
    for block in source:
        if len(block.samples):
            now = time.time()
            late.append(now - (block.t_s + (len(block.samples) - 1) / fs))
            heard.append(block.samples[:, 0])
        flags |= set(block.flags)
    busy = time.process_time() - busy
    publisher_s = float(child.stdout.readline())
    source.close()
    child.communicate("\n")
    numbers = np.concatenate(heard)
    return {
        **_figures(numbers, fs, seconds, late),
        "subscriber_cpu": busy / seconds,
        "publisher_cpu": publisher_s / seconds,
        "flags": sorted(flags - {flag for flag in flags if flag.startswith("silent")}),
    }


def over_udp(fs: float, seconds: float) -> dict[str, float]:
    """Send bare datagrams in another process and count them here."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(2.0)
        child = _child("udp", receiver.getsockname()[1], fs, seconds)
        busy = time.process_time()
        rows = np.array(list(_datagrams(receiver, child)))
        busy = time.process_time() - busy
    publisher_s = float(child.stdout.readline())
    child.communicate()
    return {
        **_figures(rows[:, 0], fs, seconds, rows[:, 1]),
        "subscriber_cpu": busy / seconds,
        "publisher_cpu": publisher_s / seconds,
        "flags": [],
    }


def _datagrams(receiver: socket.socket, child: subprocess.Popen) -> Iterator[tuple[float, float]]:
    """Yield number and lateness of what arrives."""
    while True:
        try:
            number, stamp_ns = struct.unpack_from("<qq", receiver.recv(2048))
        except TimeoutError:
            if child.poll() is not None:
                return
        else:
            yield number, (time.time_ns() - stamp_ns) / 1e9


def _figures(numbers: np.ndarray, fs: float, seconds: float, late: list[float]) -> dict[str, float]:
    sent = int(fs * seconds)
    p50, p99, most = 1e3 * np.percentile(late, [50, 99, 100])
    return {
        "sent": sent,
        "received": len(numbers),
        "lost": sent - len(np.unique(numbers)),
        "in_order": bool(np.all(np.diff(numbers) > 0)),
        "p50_ms": float(p50),
        "p99_ms": float(p99),
        "most_ms": float(most),
    }


def _child(*arguments: object) -> subprocess.Popen:
    command = [sys.executable, str(CHILD), *map(str, arguments)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def as_markdown(result: dict) -> str:
    """Return the result as a page."""
    lines = [
        "# ROS 2 messages between two processes without ROS",
        "",
        "`sensor_msgs/Imu` over DDS (CycloneDDS, loopback, reliable, 20,000 messages kept), one message a "
        f"sample, {result['seconds']:g} s each; the subscriber is the source of blocks that `texclass "
        "stream` reads. The publisher is never early and sends what is due at least every millisecond. "
        "Lateness is from the stamp of a block's last message to the block in hand; the reference is a bare "
        "UDP socket with "
        "datagrams of the same size, in the same run.",
        "",
        "| rate (Hz) | way | sent | lost | in order | p50 (ms) | p99 (ms) | most (ms) | p50, times UDP "
        "| subscriber (cores) | publisher (cores) |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        cells = [
            *(str(row[key]) for key in ("fs", "way", "sent", "lost")),
            "yes" if row["in_order"] else "no",
            *(f"{row[key]:.2f}" for key in ("p50_ms", "p99_ms")),
            *(f"{row[key]:.1f}" for key in ("most_ms", "times_udp")),
            *(f"{row[key]:.2f}" for key in ("subscriber_cpu", "publisher_cpu")),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    flags = sorted({flag for row in result["rows"] for flag in row["flags"]})
    made = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    load = ", ".join(f"{value:.1f}" for value in result["load"])
    return "\n".join(
        [
            *lines,
            "",
            f"Reported by the source: {', '.join(flags) or 'nothing'}. Load of the machine "
            f"({result['cores']} cores) before and after: {load}. No random numbers, no input files: samples "
            "count up.",
            "",
            f"Versions: {made}. {result['platform']}.",
            "",
        ]
    )


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "studies")
    options = parser.parse_args()
    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    rows, load = [], [os.getloadavg()[0]]
    for fs in RATES_HZ:
        reference = over_udp(fs, options.seconds)
        for way, figures in (("UDP", reference), ("DDS", over_dds(fs, options.seconds))):
            rows.append(
                {"fs": fs, "way": way, **figures, "times_udp": figures["p50_ms"] / reference["p50_ms"]}
            )
    result = {
        "seconds": options.seconds,
        "rows": rows,
        "load": [*load, os.getloadavg()[0]],
        "cores": os.cpu_count(),
        "versions": versions("cyclonedds", "numpy"),
        "platform": f"{platform.system()} {platform.machine()}",
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "dds.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (options.out / "dds.md").write_text(as_markdown(result), encoding="utf-8")
    print(as_markdown(result))


if __name__ == "__main__":
    main()
