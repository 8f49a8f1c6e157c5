"""Child process of the DDS tests: publishes an Imu whose x counts samples, the rows of a file, or answers."""

import socket
import struct
import sys
import time
from collections.abc import Callable

import numpy as np

from texclass.robot import AnswerPublisher, ImuPublisher


def publish_imu(topic: str, fs: float, seconds: float, first: int) -> None:
    """Wait for a subscriber, then publish at fs Hz by the clock."""
    publisher = ImuPublisher(topic)
    while not publisher.n_subscribers:
        time.sleep(0.005)
    paced(fs, seconds, lambda i, stamp: publisher.publish(stamp, (first + i, 0.5, 9.81)))
    sys.stdin.readline()
    publisher.close()


def publish_rows(topic: str, fs: float, path: str) -> None:
    """Publish acceleration and turn rate of a .npy file, with time stamps at fs Hz, ten times as fast."""
    rows, start_ns = np.load(path), time.time_ns()
    publisher = ImuPublisher(topic)
    while not publisher.n_subscribers:
        time.sleep(0.005)

    def send(i: int, _: int) -> None:
        publisher.publish(start_ns + round(i * 1e9 / fs), rows[i, :3], rows[i, 3:])

    paced(10 * fs, len(rows) / (10 * fs), send)
    sys.stdin.readline()
    publisher.close()


def send_datagrams(port: int, fs: float, seconds: float) -> None:
    """Send UDP datagrams of the size of an Imu, with number and time, as a reference for the network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        paced(fs, seconds, lambda i, t: sender.sendto(struct.pack("<qq308x", i, t), ("127.0.0.1", port)))


def paced(fs: float, seconds: float, send: Callable[[int, int], object]) -> None:
    """Call send(number, time in ns) at fs Hz, never early, and print the CPU time in seconds."""
    start, start_ns, busy = time.perf_counter(), time.time_ns(), time.process_time()
    for i in range(int(fs * seconds)):
        while (remaining_s := start + i / fs - time.perf_counter()) > 0:
            time.sleep(max(remaining_s, 0.001))
        send(i, start_ns + round(i * 1e9 / fs))
    print(time.process_time() - busy, flush=True)


def publish_answers(topic: str, diagnostics: str) -> None:
    """Publish two answers repeatedly for five seconds."""
    publisher = AnswerPublisher(topic, diagnostics)
    answers = (
        {"surface": "wood", "probability": 0.9, "unknown": False, "reasons": []},
        {"surface": "wood", "probability": 0.2, "unknown": True, "reasons": ["unlike training"]},
    )
    for _ in range(100):
        for answer in answers:
            publisher.publish(answer, stamp_ns=5_000_000_007)
        time.sleep(0.05)


if __name__ == "__main__":
    if sys.argv[1] == "imu":
        publish_imu(sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), int(sys.argv[5]))
    elif sys.argv[1] == "rows":
        publish_rows(sys.argv[2], float(sys.argv[3]), sys.argv[4])
    elif sys.argv[1] == "udp":
        send_datagrams(int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4]))
    else:
        publish_answers(sys.argv[2], sys.argv[3])
