"""Named faults at the seam: each kind does what its name says, to what it names, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi, radians
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from tests.rig_contract import Factory, contract

from spsp_ctrl.config.injection import Injection
from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.messages import (
    NO_BASE,
    NO_MEASUREMENT,
    AzimuthSample,
    Command,
    DriveSample,
    ImuSample,
    Measurement,
    ResolverSample,
    TemperatureSample,
    Truth,
)
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.rig.base import Rig, RigIdentity
from spsp_ctrl.rig.injection import InjectedRig
from spsp_ctrl.rig.signals import BY_NAME, KINDS, SIGNALS
from spsp_ctrl.rig.simulated import SimulatedRig

CONFIG = Path(__file__).parents[2] / "config"
MS = 1_000_000


@dataclass
class Counter:
    """A rig whose numbers are the time in ms; frames of all signals in every cycle."""

    got: Command | None = None

    def open(self) -> RigIdentity:
        return RigIdentity("test", "counter", "", "", True)

    def read(self, now_ns: int) -> Measurement:
        k = now_ns // MS
        x = float(k)
        return NO_MEASUREMENT._replace(
            stamp_ns=now_ns,
            cycle=k,
            imu=ImuSample(now_ns, now_ns, k, True, x, x, x, x, x, x),
            resolver_pitch=ResolverSample(now_ns, k, k, 0),
            drive_pitch=DriveSample(now_ns, k, True, 0, x, x),
            azimuth=AzimuthSample(now_ns, k, True, k, x, False, False, False),
            temperature=TemperatureSample(now_ns, k, x, x, x, x),
            base=NO_BASE,
        )

    def write(self, command: Command, now_ns: int) -> Command:
        self.got = command
        return command if isfinite(command.pitch_current_a) else command._replace(enable=False)

    def stop(self) -> None: ...
    def close(self) -> None: ...
    def truth(self) -> Truth | None:
        return None


def played(signal: str, kind: str, cycles: int = 400, **more: Any) -> list[Measurement]:
    """What arrives when the fault acts from 100 ms to 300 ms."""
    injection = Injection.model_validate({"signal": signal, "kind": kind, "at_s": 0.1, "duration_s": 0.2} | more)
    rig = InjectedRig(Counter(), (injection,), 1)
    return [rig.read(k * MS) for k in range(cycles)]


def simulated() -> Rig:
    scenario = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model
    faults = (Injection(signal="base", kind="noisy", at_s=0.02), Injection(signal="command.azimuth", kind="slow", at_s=0.0))
    return InjectedRig(SimulatedRig(load_rig(CONFIG / "rig.yaml").model, load_model(CONFIG / "model.yaml"), scenario, 1), faults, 1)


@contract
def test_a_rig_with_faults_is_still_a_rig(check: Any) -> None:
    make: Factory = simulated
    check(make)


@pytest.mark.parametrize("kind", KINDS)
def test_only_what_is_named_is_hurt_and_only_while_it_acts(kind: str) -> None:
    clean = [Counter().read(k * MS) for k in range(320)]
    for signal in SIGNALS:
        if signal.sample < 0:
            continue
        hurt = played(signal.name, kind, 320)
        for k, (a, b) in enumerate(zip(clean, hurt, strict=True)):
            if k < 100 or k >= 300:
                assert a == b, (signal.name, k)
            else:
                assert a[: signal.sample] + a[signal.sample + 1 :] == b[: signal.sample] + b[signal.sample + 1 :]
        changed = any(a[signal.sample] != b[signal.sample] for a, b in zip(clean, hurt, strict=True))
        assert changed or kind not in ("garbage", "wrong") or signal.name.startswith(("resolver_roll", "drive_roll", "base"))
        assert list(map(str, played(signal.name, kind, 320))) == list(map(str, hurt))  # NaN too


def test_whole_frames() -> None:
    assert [m.imu.seq for m in played("imu", "off")][98:302] == [98, 99, *[99] * 200, 300, 301]
    stuck = played("imu", "stuck")[200].imu
    assert (stuck.seq, stuck.stamp_ns, stuck.received_ns, stuck.pitch_rad) == (200, 200 * MS, 200 * MS, 99.0)
    wrong = played("imu", "wrong", size=3.0)[200].imu
    assert wrong.pitch_rad == pytest.approx(200.0 + radians(3.0))
    assert wrong.roll_rad == pytest.approx(200.0 + radians(3.0))
    assert wrong.yaw_rad == 200.0
    slow = [m.resolver_pitch.seq for m in played("resolver_pitch", "slow", every=4)]
    assert slow[100:112] == [99, 99, 99, 103, 103, 103, 103, 107, 107, 107, 107, 111]
    late = played("resolver_pitch", "delayed", delay_ms=7.0)
    assert [m.resolver_pitch.seq for m in late][100:103] == [93, 94, 95]
    assert late[150].resolver_pitch.stamp_ns == 143 * MS
    bursts = [m.resolver_pitch.seq for m in played("resolver_pitch", "intermittent", off_ms=3.0, on_ms=2.0)]
    assert bursts[100:110] == [99, 99, 99, 103, 104, 104, 104, 104, 108, 109]
    garbage = {m.resolver_pitch.counts for m in played("resolver_pitch", "garbage")[100:300]}
    assert 2 <= len(garbage) <= 5
    noise = [m.resolver_pitch.counts - m.cycle for m in played("resolver_pitch", "noisy", size=50.0)[100:300]]
    assert 35.0 < (sum(n * n for n in noise) / 200) ** 0.5 < 65.0


def test_channels_of_frames_that_go_on() -> None:
    def seen(kind: str, **more: Any) -> list[float]:
        frames = [m.imu for m in played("imu.pitch", kind, **more)]
        assert [f.seq for f in frames] == list(range(400))
        assert [f.roll_rad for f in frames] == [float(k) for k in range(400)]
        return [f.pitch_rad for f in frames]

    assert seen("off")[99:102] == [99.0, 0.0, 0.0]
    assert seen("stuck")[99:102] == [99.0, 99.0, 99.0]
    assert seen("wrong", size=-1.0)[100] == pytest.approx(100.0 - radians(1.0))
    assert seen("slow", every=3)[100:107] == [99.0, 99.0, 102.0, 102.0, 102.0, 105.0, 105.0]
    assert seen("delayed", delay_ms=20.0)[150] == 130.0
    assert seen("intermittent", off_ms=2.0, on_ms=3.0)[100:106] == [0.0, 0.0, 102.0, 103.0, 104.0, 0.0]
    assert any(not isfinite(x) for x in seen("garbage")[100:300])
    pressed = [m.azimuth.left_switch for m in played("azimuth.left_switch", "wrong")]
    assert pressed[99:101] == [False, True]
    assert {type(x) for x in pressed} == {bool}


def test_commands_on_their_way() -> None:
    command = Command(0, 0, True, 1.0, 2.0, 3.0, 4.0, 0.5)

    def arrives(kind: str, at_ms: int = 150, **more: Any) -> tuple[Command, Command]:
        rig = Counter()
        injection = Injection.model_validate({"signal": "command.pitch", "kind": kind, "at_s": 0.1} | more)
        hurt = InjectedRig(rig, (injection,), 1)
        for k in range(at_ms + 1):
            hurt.read(k * MS)
            now = command._replace(stamp_ns=k * MS, pitch_current_a=float(k))
            sent = hurt.write(now, k * MS)
        assert rig.got is not None
        return rig.got, sent

    for kind, current in (("off", 0.0), ("stuck", 99.0), ("delayed", 130.0), ("wrong", 153.0)):
        got, sent = arrives(kind, **({"delay_ms": 20.0} if kind == "delayed" else {"size": 3.0} if kind == "wrong" else {}))
        assert got.pitch_current_a == current
        assert (got.roll_current_a, got.roll_speed_rad_s, got.azimuth_rate_rad_s, got.enable) == (3.0, 4.0, 0.5, True)
        # the sender does not know
        assert sent.pitch_current_a == 150.0
    rig = Counter()
    hurt = InjectedRig(rig, (Injection(signal="command.pitch", kind="garbage", at_s=0.0),), 1)
    refused = [hurt.write(command, k * MS) for k in range(20)]
    assert not all(c.enable for c in refused), "what the rig refuses is told"


def test_a_row_that_makes_no_sense_is_refused() -> None:
    wrong = ({"kind": "off", "size": 1.0}, {"kind": "noisy", "every": 3}, {"kind": "wrong", "delay_ms": 5.0}, {"kind": "loud"}, {"signal": "imu.w"})
    for row in wrong:
        with pytest.raises(ValidationError):
            Injection.model_validate({"signal": "imu", "kind": "off", "at_s": 1.0} | row)


def test_every_signal_has_a_place_and_sizes() -> None:
    from typing import get_args

    from spsp_ctrl.config.injection import Kind, SignalName

    assert set(get_args(SignalName)) == BY_NAME.keys()
    assert get_args(Kind) == KINDS
    assert len(SIGNALS) * len(KINDS) * 2 > 300
    assert BY_NAME["imu.yaw"].factor == pytest.approx(pi / 180.0)
