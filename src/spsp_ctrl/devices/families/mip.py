"""MicroStrain units as the rig uses them: attitude and rate in the frame of the design (x forward, y left, z up), stamped on the control clock."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from spsp_ctrl.devices.clock_host import DeviceClock
from spsp_ctrl.devices.families.base import NOBODY, Identity, ImuSetup
from spsp_ctrl.devices.mip_host import ImuDecoder, PacketParser, SetUp
from spsp_ctrl.messages import NO_IMU, ImuSample

if TYPE_CHECKING:
    from spsp_ctrl.config.devices import ImuUnit


class MipUnit:
    """One unit, mounted upright with x forward. Its own frame has y to the right and z down: pitch, yaw and their rates change sign."""

    def __init__(self, unit: ImuUnit, setup: ImuSetup) -> None:
        self._rate_hz = setup.rate_hz
        self._dialogue = SetUp(round(setup.rate_hz))
        self._parser = PacketParser()
        self._decoder = ImuDecoder()
        self._clock = DeviceClock(setup.delay_ns)
        self._period_ns = 1e9 / setup.rate_hz
        self.done = False
        self.problem = ""
        self.identity = NOBODY
        self.imu: ImuSample = NO_IMU
        self.device_ns = -1

    def start_up(self, now_ns: int, data: bytes) -> bytes:
        """See ``ImuFamily``."""
        out = self._dialogue.step(now_ns, self._parser.feed(data))
        self.problem = self._dialogue.problem
        if self._dialogue.done and not self.done and not self.problem:
            info = self._dialogue.info
            words = ["MicroStrain", info.model_name, info.serial_number, info.firmware] if info else list(NOBODY)
            self.restore({"rate_hz": self._dialogue.rate_hz, "identity": words})
        return out

    def facts(self) -> dict[str, Any]:
        """See ``Dialogue``."""
        return {"rate_hz": 1e9 / self._period_ns, "identity": list(self.identity)}

    def restore(self, facts: dict[str, Any]) -> None:
        """See ``Dialogue``."""
        rate = float(facts["rate_hz"])
        self._period_ns = 1e9 / rate
        self.identity = Identity(*facts["identity"])
        self.done = True
        if abs(rate - self._rate_hz) > 0.01 * self._rate_hz:
            self.problem = f"the IMU can stream at {rate:g} Hz, not at the {self._rate_hz:g} Hz of imu.rate_hz; change the rig file (and its gains)"

    @property
    def skipped_bytes(self) -> int:
        """Bytes that belonged to no packet."""
        return self._parser.skipped_bytes

    @property
    def bad_packets(self) -> int:
        """Packets that were damaged."""
        return self._parser.bad_packets

    def receive(self, data: bytes, received_ns: int) -> None:
        """See ``ImuFamily``. Of several attitudes in one piece the last one counts."""
        for reading in self._decoder.decode(self._parser.feed(data)):
            device_ns, valid, roll, pitch, yaw, x, y, z = reading
            self.device_ns = device_ns
            stamp = self._clock.stamp(device_ns, received_ns)
            seq = round(device_ns / self._period_ns) if device_ns >= 0 else self.imu.seq + 1
            self.imu = ImuSample(stamp, received_ns, seq, valid, roll, -pitch, -yaw, x, -y, -z)
