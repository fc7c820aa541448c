"""CiA 402 drives as the rig uses them: SI in and out, torque in thousandths of the rated current, position in counts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from spsp_ctrl.devices import canopen_host as host
from spsp_ctrl.devices import canopen_table as T
from spsp_ctrl.devices import cia402_host as drive
from spsp_ctrl.devices.canopen_host import Frame, SdoDialogue, Setting
from spsp_ctrl.devices.families.base import MASTER, NOBODY, DriveSetup, Identity
from spsp_ctrl.devices.scaling import TEMPERATURE_STEP_C, amperes, counts_s, permille
from spsp_ctrl.messages import NO_DRIVE, NO_RESOLVER, DriveSample, ResolverSample

if TYPE_CHECKING:
    from spsp_ctrl.config.devices import DriveNode

UNKNOWN_FAULT = 0xFFFF
"""Fault code of a drive that is in a fault and has not said which."""
_new = tuple.__new__


class Cia402Drive:
    """One drive in torque (CST) or velocity mode (CSV)."""

    synced = True

    def __init__(self, node: DriveNode, setup: DriveSetup) -> None:
        self._node = node.node
        self._setup = setup
        self._expect_a = node.rated_current_a
        self._temperature_object = node.temperature_object
        self._sign = -1 if node.reversed else 1
        self._mode = T.CSV if setup.velocity else T.CST
        period_ms = max(1, round(1e3 / setup.rate_hz))
        wanted = [*drive.start_up(self._node, self._mode, period_ms, MASTER, node.heartbeat_ms), Setting(T.BUS_VOLTAGE, 0, None, 4)]
        self._dialogue = SdoDialogue(self._node, wanted)
        self._walker = Idler()
        self._counter = host.Counter()
        self._word = 0
        self._bus_v = 0.0
        self._code = 0
        self._rated_a = 1.0
        self._questions: SdoDialogue | None = None
        self._answers: list[Frame] = []
        self._tpdo, self._slow, self._emcy, self._sdo = (base + self._node for base in (T.TPDO1, T.TPDO2, T.EMCY, T.SDO_REPLY))
        self.done = False
        self.problem = ""
        self.identity = NOBODY
        self.drive: DriveSample = NO_DRIVE
        self.shaft: ResolverSample = NO_RESOLVER
        self.temperatures_c: tuple[float, float] | None = None

    def start_up(self, now_ns: int, frames: list[Frame]) -> list[Frame]:
        """See ``DriveFamily``."""
        out = self._dialogue.step(now_ns, frames)
        self.problem = self._dialogue.problem
        if self._dialogue.done and not self.done and not self.problem:
            v = self._dialogue.values
            if v[T.DEVICE_TYPE, 0] & 0xFFFF != 402:
                self.problem = f"node {self._node} is no CiA 402 drive (device type 0x{v[T.DEVICE_TYPE, 0]:08X})"
            elif not drive.supports(v[T.SUPPORTED_MODES, 0], self._mode):
                self.problem = f"the drive at node {self._node} does not support mode {'CSV' if self._setup.velocity else 'CST'}"
            else:
                words = [f"0x{v[T.IDENTITY, sub]:08X}" for sub in (1, 2, 4, 3)]
                self.restore({"rated_a": v[T.RATED_CURRENT, 0] * 1e-3, "bus_v": v[T.BUS_VOLTAGE, 0] * 1e-3, "identity": words})
        return out

    def facts(self) -> dict[str, Any]:
        """See ``Dialogue``."""
        return {"rated_a": self._rated_a, "bus_v": self._bus_v, "identity": list(self.identity)}

    def restore(self, facts: dict[str, Any]) -> None:
        """See ``Dialogue``."""
        self._rated_a, self._bus_v = float(facts["rated_a"]), float(facts["bus_v"])
        self.identity = Identity(*facts["identity"])
        self.done = True
        if not self._rated_a > 0.0:
            self.problem = f"the drive at node {self._node} has no rated current (0x6075): set it with the maker's tool"
        elif self._expect_a is not None and abs(self._expect_a - self._rated_a) > 1e-3 * self._expect_a:
            text = f"the drive at node {self._node} has a rated current of {self._rated_a:g} A, the rig file says {self._expect_a:g} A"
            self.problem = f"{text}: torque would be wrong by that ratio"

    def operate(self) -> list[Frame]:
        """See ``DriveFamily``."""
        return [host.nmt(T.NMT_START, self._node)]

    def prepare(self) -> list[Frame]:
        """Controlword by SDO: ready, then switched on (no current before an enabling command)."""
        return [host.write(self._node, T.CONTROLWORD, 0, word, 2) for word in (T.SHUTDOWN, T.SWITCH_ON)]

    def receive(self, frame: Frame, stamp_ns: int, seq: int) -> None:
        """See ``DriveFamily``."""
        identifier = frame[0]
        if identifier == self._tpdo:
            status = drive.read_status(frame, self._node)
            if status is None:
                return
            self._word, counts, torque = status
            state = drive.state_of(self._word)
            code = (self._code or UNKNOWN_FAULT) if state in (T.FAULT, T.FAULT_REACTION) else 0
            current = amperes(self._sign * torque, self._rated_a)
            enabled = state is T.OPERATION_ENABLED
            self.drive = _new(DriveSample, (stamp_ns, seq, enabled, code, current, self._bus_v))
            self.shaft = _new(ResolverSample, (stamp_ns, seq, self._sign * self._counter.step(counts), 0))
        elif identifier == self._slow:
            slow = drive.read_slow(frame, self._node)
            if slow is not None:
                self._bus_v = slow.bus_voltage_v
                self._code = slow.error_code
        elif identifier == self._sdo:
            self._answers.append(frame)
        elif identifier == self._emcy:
            found = host.read_emergency(frame, self._node)
            if found is not None:
                self._code = found.code

    def command(self, enable: bool, current_a: float, speed_rad_s: float, now_ns: int) -> list[Frame]:
        """See ``DriveFamily``."""
        word = self._walker.step(self._word, enable)
        torque = self._sign * permille(current_a, self._rated_a) if enable else 0
        if not self._setup.velocity:
            return [drive.torque_command(self._node, word, torque)]
        speed = self._sign * counts_s(speed_rad_s, self._setup.counts_per_turn) if enable else 0
        return [drive.velocity_command(self._node, word, speed, torque)]

    def reset(self) -> None:
        """Acknowledge a fault with the next commands."""
        self._walker.reset()

    def ask_temperatures(self, now_ns: int) -> None:
        """See ``DriveFamily``."""
        if self._temperature_object is not None and self._questions is None:
            self._questions = SdoDialogue(self._node, [Setting(self._temperature_object, sub, None, 2) for sub in (1, 2)])

    def ask(self, now_ns: int) -> list[Frame]:
        """See ``DriveFamily``."""
        asked = self._questions
        if asked is None:
            self._answers.clear()
            return []
        out = asked.step(now_ns, self._answers)
        self._answers.clear()
        if asked.done:
            raw = [asked.values[self._temperature_object or 0, sub] for sub in (1, 2)]
            first, second = (TEMPERATURE_STEP_C * (r - 0x10000 if r & 0x8000 else r) for r in raw)
            self.temperatures_c = (first, second)
        if asked.done or asked.problem:
            self._questions = None
        return out

    def stop(self) -> list[Frame]:
        """See ``DriveFamily``."""
        if self._setup.velocity:
            return [drive.velocity_command(self._node, T.DISABLE_VOLTAGE, 0.0, 0.0)]
        return [drive.torque_command(self._node, T.DISABLE_VOLTAGE, 0.0)]

    def leave(self) -> list[Frame]:
        """See ``DriveFamily``."""
        return [host.nmt(T.NMT_RESET_COMMUNICATION, self._node)]


class Idler(drive.Walker):
    """A drive that is not wanted rests switched on, one step before current: then enabling acts with the very next SYNC."""

    def step(self, word: int, wanted: bool) -> int:
        """Next controlword for the statusword of this cycle."""
        state = drive.state_of(word)
        if wanted or state in (T.FAULT, T.FAULT_REACTION, T.NOT_READY, T.QUICK_STOP_ACTIVE):
            return super().step(word, wanted)
        self._reset = 0
        return T.SHUTDOWN if state is T.SWITCH_ON_DISABLED else T.SWITCH_ON


