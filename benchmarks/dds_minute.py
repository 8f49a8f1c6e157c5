"""A minute of ROS 2 messages between two processes over loopback, at 1 and 10 kHz: losses and delays.

`python benchmarks/dds_minute.py [--seconds S]` (four minutes) writes reports/studies/dds. The reference
is a bare UDP socket with datagrams of the same size, sent by the same process in the same run.
"""

import os
import platform
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from study import ROOT, command_line, table, write

from texclass.robot import topic_blocks

CHILD = ROOT / "tests" / "robot" / "dds" / "dds_child.py"
RATES_HZ = (1000, 10_000)
LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
)


def child(*arguments: object) -> subprocess.Popen:
    """Start the publisher."""
    command = [sys.executable, str(CHILD), *map(str, arguments)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def over_dds(fs: float, seconds: float) -> dict[str, Any]:
    """Publish in another process, hear it as `texclass stream` does, and compare."""
    publisher = child("imu", f"/minute{fs}", fs, seconds, 0)
    source = topic_blocks(f"/minute{fs}", fs=fs, end_s=2.0)
    busy = time.process_time()
    received, late, flags = [], [], set()
    for block in source:
        if len(block.samples):
            late.append(time.time() - (block.t_s + (len(block.samples) - 1) / fs))
            received.append(block.samples[:, 0])
        flags |= {flag for flag in block.flags if not flag.startswith("silence")}
    busy = time.process_time() - busy
    publisher_s = float(publisher.stdout.readline())
    source.close()
    publisher.communicate("\n")
    return figures(np.concatenate(received), late, fs, seconds, busy, publisher_s) | {"flags": sorted(flags)}


def over_udp(fs: float, seconds: float) -> dict[str, Any]:
    """Send bare datagrams in another process and count them here."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(2.0)
        publisher = child("udp", receiver.getsockname()[1], fs, seconds)
        busy = time.process_time()
        numbers, late = np.array(list(datagrams(receiver, publisher))).T
        busy = time.process_time() - busy
    publisher_s = float(publisher.stdout.readline())
    publisher.communicate()
    return figures(numbers, late, fs, seconds, busy, publisher_s) | {"flags": []}


def datagrams(receiver: socket.socket, publisher: subprocess.Popen) -> Iterator[tuple[float, float]]:
    """Yield number and lateness of what arrives."""
    while True:
        try:
            number, stamp_ns = struct.unpack_from("<qq", receiver.recv(2048))
        except TimeoutError:
            if publisher.poll() is not None:
                return
        else:
            yield number, (time.time_ns() - stamp_ns) / 1e9


def figures(
    numbers: np.ndarray, late: np.ndarray, fs: float, seconds: float, busy: float, publisher_s: float
) -> dict[str, Any]:
    """Return what was lost, how late the rest was, and what both sides computed."""
    sent = int(fs * seconds)
    p50, p99, p100 = 1e3 * np.percentile(late, [50, 99, 100])
    return {
        "sent": sent,
        "received": len(numbers),
        "lost": sent - len(np.unique(numbers)),
        "in_order": bool(np.all(np.diff(numbers) > 0)),
        "p50_ms": p50,
        "p99_ms": p99,
        "most_ms": p100,
        "subscriber_cpu": busy / seconds,
        "publisher_cpu": publisher_s / seconds,
    }


def main() -> None:
    args = command_line(__doc__, seconds=60.0)
    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    rows, load = [], [os.getloadavg()[0]]
    for fs in RATES_HZ:
        reference = over_udp(fs, args.seconds)
        for way, delays in (("UDP", reference), ("DDS", over_dds(fs, args.seconds))):
            times = delays["p50_ms"] / reference["p50_ms"]
            rows.append({"fs": fs, "way": way, **delays, "times_udp": times})
    result = {
        "seconds": args.seconds,
        "rows": rows,
        "load": [*load, os.getloadavg()[0]],
        "cores": os.cpu_count(),
        "platform": f"{platform.system()} {platform.machine()}",
    }
    flags = sorted({flag for row in rows for flag in row["flags"]})
    blocks = [
        "`sensor_msgs/Imu` over DDS (CycloneDDS, loopback, reliable, 20,000 messages kept), one message a "
        f"sample, {args.seconds:g} s each; the subscriber is the source of blocks that `texclass stream` "
        "reads. The publisher is never early and sends what is due at least every millisecond. Lateness is "
        "from the stamp of a block's last message to the block in hand; the reference is a bare UDP socket "
        "with datagrams of the same size, in the same run.",
        table(
            rows,
            "rate (Hz) = {fs} | way = {way} | sent = {sent} | lost = {lost} | in order = {in_order} | "
            "p50 (ms) = {p50_ms:.2f} | p99 (ms) = {p99_ms:.2f} | most (ms) = {most_ms:.1f} | "
            "p50, times UDP = {times_udp:.1f} | subscriber (cores) = {subscriber_cpu:.2f} | "
            "publisher (cores) = {publisher_cpu:.2f}",
            n_words=2,
        ),
        f"Reported by the source: {', '.join(flags) or 'nothing'}. Load of the machine ({result['cores']} "
        f"cores) before and after: {', '.join(f'{value:.1f}' for value in result['load'])}. No random "
        "numbers, no input files: samples count up.",
    ]
    write(args.out, "dds", result, "ROS 2 messages between two processes without ROS", blocks)


if __name__ == "__main__":
    main()
