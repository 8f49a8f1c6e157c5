"""DDS over loopback only, in a domain that no other test worker uses."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")

LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<LeaseDuration>1s</LeaseDuration><Peers><Peer address='127.0.0.1'/></Peers></Discovery>"
    "</Domain></CycloneDDS>"
)


@pytest.fixture(scope="session", autouse=True)
def loopback():
    """Set the environment variables of CycloneDDS and ROS 2, which child processes inherit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CYCLONEDDS_URI", LOOPBACK)
        patch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
        yield


@pytest.fixture
def child():
    """Return a function that starts a child process, which is stopped at the end of the test."""
    processes = []

    def start(*arguments):
        command = [sys.executable, str(Path(__file__).with_name("dds_child.py")), *map(str, arguments)]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()
