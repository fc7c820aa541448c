"""Trinamic steppers as the rig uses them. Right is where a module counts up: the positive end, which the rig calls left."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from spsp_ctrl.devices import tmcl_host as host
from spsp_ctrl.devices import tmcl_table as T
from spsp_ctrl.devices.canopen_host import Frame
from spsp_ctrl.devices.families.base import NOBODY, Identity, StepperSetup
from spsp_ctrl.devices.scaling import pulses_s

if TYPE_CHECKING:
    from spsp_ctrl.config.devices import StepperModule


class TmclStepper:
    """One motor of a module, on a serial line or on CAN."""

    START_TIMEOUT_NS = 300_000_000
    TRIES = 4

    def __init__(self, module: StepperModule, setup: StepperSetup) -> None:
        self._setup = setup
        self._on_can = module.bus is not None
        self._address, self._host, self._motor = module.address, module.host, module.motor
        self._sign = -1 if module.reversed else 1
        unit = host.SpeedUnit(-1 if module.pulse_divisor is None else module.pulse_divisor)
        self._stepper = host.Stepper(module.motor, unit, paced=True)
        self._replies = host.SerialReplies(module.host, module.address)
        self._asked = 0
        self._sent_ns = 0
        self._tries = 0
        self._microsteps = 0
        self.done = False
        self.problem = ""
        self.identity = NOBODY
        self.position_microsteps = 0
        self.rate_microsteps_s = 0.0
        self.positive_switch = self.negative_switch = self.home_switch = False
        self.stamp_ns = 0
        self.seq = -1

    def _arrived(self, frames: list[Frame], data: bytes) -> list[host.Reply]:
        if self._on_can:
            found = (host.from_can(i, d, self._host, self._address) for i, d in frames)
            return [reply for reply in found if reply is not None]
        return self._replies.feed(data)

    def _sent(self, request: host.Request | None) -> tuple[list[Frame], bytes]:
        if request is None:
            return [], b""
        if self._on_can:
            return [host.to_can(request, self._address)], b""
        return [], host.to_serial(request, self._address)

    def start_up(self, now_ns: int, frames: list[Frame], data: bytes) -> tuple[list[Frame], bytes]:
        """See ``StepperFamily``: who is it, is it still, and has it the micro-stepping of the rig file?"""
        questions = (
            host.Request(T.VERSION, T.VERSION_BINARY, 0, 0),
            host.stop(self._motor),
            host.get(self._motor, T.MICROSTEPS),
        )
        for reply in self._arrived(frames, data):
            if self.done or self.problem or not self._tries or reply.instruction != questions[self._asked].instruction:
                continue
            if reply.status != T.OK:
                self.problem = f"the stepper module refuses instruction {reply.instruction}: {T.STATUS_TEXT.get(reply.status, 'unknown status')}"
                return [], b""
            if self._asked == 0:
                number = reply.value & 0xFFFFFFFF
                self.identity = Identity("Trinamic", f"TMCM-{number >> 16}", "", f"{number >> 8 & 0xFF}.{number & 0xFF:02d}")
            elif self._asked == 2:
                self._microsteps = 1 << min(max(reply.value, 0), 8)
            self._asked, self._tries = self._asked + 1, 0
            if self._asked == len(questions):
                self.restore({"microsteps": self._microsteps, "identity": list(self.identity)})
        if self.done or self.problem or (self._tries and now_ns - self._sent_ns < self.START_TIMEOUT_NS):
            return [], b""
        if self._tries == self.TRIES:
            self.problem = f"the stepper module at address {self._address} does not answer"
            return [], b""
        self._tries += 1
        self._sent_ns = now_ns
        return self._sent(questions[self._asked])

    def facts(self) -> dict[str, Any]:
        """See ``Dialogue``."""
        return {"microsteps": self._microsteps, "identity": list(self.identity)}

    def restore(self, facts: dict[str, Any]) -> None:
        """See ``Dialogue``."""
        self._microsteps = int(facts["microsteps"])
        self.identity = Identity(*facts["identity"])
        self.done = True
        if self._microsteps != self._setup.microsteps:
            self.problem = f"the stepper module makes {self._microsteps} microsteps per step, azimuth.microsteps says {self._setup.microsteps}"

    def rate(self, rad_s: float) -> None:
        """See ``StepperFamily``."""
        self._stepper.command(self._sign * pulses_s(rad_s, self._setup.microsteps_per_rad))

    def halt(self) -> None:
        """See ``StepperFamily``."""
        self._stepper.halt()

    def round(self) -> None:
        """See ``StepperFamily``."""
        self._stepper.ask_again()

    def exchange(self, now_ns: int, frames: list[Frame], data: bytes) -> tuple[list[Frame], bytes]:
        """See ``StepperFamily``."""
        out = self._sent(self._stepper.step(now_ns, self._arrived(frames, data)))
        position, speed, left, right, home, stamp, seq = self._stepper.reading
        if seq != self.seq:
            self.position_microsteps, self.rate_microsteps_s = self._sign * position, self._sign * speed
            self.positive_switch, self.negative_switch = (right, left) if self._sign > 0 else (left, right)
            self.home_switch, self.stamp_ns, self.seq = home, stamp, seq
        return out

    @property
    def lost(self) -> int:
        """Requests without an answer."""
        return self._stepper.lost

    @property
    def refused(self) -> str:
        """The newest refusal in words."""
        return self._stepper.problem
