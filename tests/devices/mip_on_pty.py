"""The simulated IMU on a pseudo-terminal, as a process of its own (the vendor's client does not let other Python threads run while it waits).

``python mip_on_pty.py FD SECONDS``: FD is the master side. Streams a known motion at its base rate until the time is over.
"""

from __future__ import annotations

import os
import select
import sys
import time
from math import cos, sin

from spsp_ctrl.devices.mip_device import ImuState, MipImu

RATE_HZ = 500
PERIOD_NS = 1_000_000_000 // RATE_HZ


def state(time_ns: int) -> ImuState:
    """Motion that the test knows too."""
    t = time_ns * 1e-9
    return ImuState(0.1 * sin(t), 0.2 * cos(t), 0.01 * t, 0.1 * cos(t), -0.2 * sin(t), 0.01)


def serve(fd: int, seconds: float) -> None:
    """Answer and stream."""
    imu, start, tick = MipImu(RATE_HZ), time.monotonic_ns(), 0
    while (now := time.monotonic_ns() - start) < seconds * 1e9:
        out = b""
        while tick * PERIOD_NS <= now:
            out += imu.sample(tick * PERIOD_NS, state(tick * PERIOD_NS))
            tick += 1
        if select.select((fd,), (), (), 0.001)[0]:
            out += imu.receive(os.read(fd, 4096))
        if out:
            os.write(fd, out)


if __name__ == "__main__":
    serve(int(sys.argv[1]), float(sys.argv[2]))
