"""The rig on buses with every byte encoded and decoded, in lock-step: the contract of every rig, and the same numbers as without a bus."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest
from tests.rig_contract import Factory, contract

from spsp_ctrl.config.devices import BusDriver, SimulatedDriver, Wire
from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices.families.registry import BUILT_IN, UnknownFamily, family
from spsp_ctrl.devices.transport.lockstep import LockstepCan, medium
from spsp_ctrl.messages import Control, Measurement, Mode, Timing, Truth
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.rig.base import Rig, RigError
from spsp_ctrl.rig.bus import BusRig
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.rig.world import LockstepWorld
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.clock import LockStepClock
from spsp_ctrl.runtime.loop import NullRecorder, run_loop

CONFIG = Path(__file__).parents[2] / "config"
RIG = load_rig(CONFIG / "rig.yaml").model
SCENARIO = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model
MODEL = load_model(CONFIG / "model.yaml")
DRIVER = {
    "driver": "bus",
    "world": "in_process",
    "can": {"can0": {"interface": "spsp-lockstep", "channel": "rig"}},
    "serial": {"imu": {"port": "spsp-lockstep"}, "stepper": {"port": "spsp-lockstep"}},
    "devices": {
        "drive_pitch": {"bus": "can0", "node": 1, "temperature_object": 0x2002},
        "drive_roll": {"bus": "can0", "node": 2, "temperature_object": 0x2002},
        "imu": {"serial": "imu"},
        "azimuth": {"serial": "stepper"},
        "base_pitch": {"bus": "can0", "node": 11},
        "base_roll": {"bus": "can0", "node": 12},
        "base_yaw": {"bus": "can0", "node": 13},
    },
}


def driver(**changes: object) -> BusDriver:
    """The devices above, some of them changed."""
    return BusDriver.model_validate(DRIVER | {"devices": DRIVER["devices"] | changes})


CHANGED = {
    "drive_pitch": {"bus": "can0", "node": 1, "temperature_object": 0x2002, "reversed": True},
    "resolver_roll": {"bus": "can0", "node": 21, "reversed": True, "offset_counts": 1234},
    "azimuth": {"bus": "can0", "address": 3, "reversed": True},
}
"""Another wiring of the same rig: one motor and the stepper turned round, a resolver node of its own, the stepper on CAN."""


def make(seed: int = 7, config: RigConfig = RIG, **changes: object) -> BusRig:
    bus = driver(**changes)
    world = LockstepWorld(config, bus, MODEL, SCENARIO, seed)
    can = {name: world.can(name) for name in bus.can}
    return BusRig(config.model_copy(update={"rig": bus}), can, {name: world.line(name) for name in bus.serial}, world.truth, world.warm_up)


@contract
def test_contract(check: Callable[[Factory], None]) -> None:
    check(make)


class _Kept(NullRecorder):
    """What the loop records, kept."""

    def __init__(self) -> None:
        self.rows: list[tuple[Measurement, Control, Truth | None]] = []

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        self.rows.append((measurement, control, truth))


def _swing(rig: Rig, config: RigConfig, seconds: float) -> list[tuple[Measurement, Control, Truth | None]]:
    kept = _Kept()
    rig.open()
    period_ns = round(1e9 / config.rate_hz)
    start = cycle.start(config, SCENARIO.reference)
    run_loop(rig, LockStepClock(period_ns), cycle.controller(config), start, round(seconds * 1e9), kept, rate_hz=config.rate_hz)
    rig.close()
    return kept.rows


CASES = [(1000, "torque", {}), (500, "torque", {}), (1000, "velocity", {}), (1000, "torque", CHANGED)]


@pytest.mark.parametrize(("rate_hz", "mode", "changes"), CASES)
def test_swing_is_the_same_to_the_last_bit(rate_hz: int, mode: str, changes: dict[str, object]) -> None:
    """Plant called directly with the steps of the wire, and every byte encoded and decoded: one run."""
    sides = {name: getattr(RIG, name).model_copy(update={"mode": mode}) for name in ("pitch_actuator", "roll_actuator")}
    imu = RIG.imu.model_copy(update={"rate_hz": 250.0 if rate_hz == 500 else 200.0})  # what fits whole cycles
    config = RIG.model_copy(update={"rate_hz": rate_hz, "imu": imu, **sides})
    wired = config.model_copy(update={"rig": SimulatedDriver(driver="simulated", wire=Wire(rated_current_a=2.5))})
    direct = _swing(SimulatedRig(wired, MODEL, SCENARIO, seed=7), wired, 4.0)
    bus = _swing(make(config=config, **changes), config, 4.0)
    assert any(control.mode == Mode.ACTIVE for _, control, _ in bus)
    assert len(direct) == len(bus)
    for k, (a, b) in enumerate(zip(direct, bus, strict=True)):
        for name in Measurement._fields:
            assert getattr(a[0], name) == getattr(b[0], name), f"cycle {k}, {name}"
        assert a[1] == b[1], f"cycle {k}, control"
        assert a[2] == b[2], f"cycle {k}, truth"


def test_another_drive_family_touches_nothing_else() -> None:
    """ODrive axes on the same bus, without SYNC of their own: armed, aligned, level. Only the family in the rig file differs."""
    drives = {name: {"family": "odrive", "bus": "can0", "node": node} for name, node in (("drive_pitch", 1), ("drive_roll", 2))}
    rows = _swing(make(**drives), RIG, 3.0)
    active = [(m, truth) for m, control, truth in rows if control.mode == Mode.ACTIVE]
    assert len(active) > 1500
    assert all(m.drive_pitch.enabled and m.drive_pitch.fault_code == 0 for m, _ in active[200:])
    assert max(abs(truth.platform_roll_rad) for _, truth in active[-500:] if truth is not None) < 2e-3


class Relabelled:
    """A plug-in that somebody else installs."""

    def __init__(self, node: object, setup: object) -> None:
        self.made = (node, setup)


def test_a_family_of_somebody_else_comes_by_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    point = metadata.EntryPoint("acme", f"{__name__}:Relabelled", "spsp_ctrl.drive")
    monkeypatch.setattr(metadata, "entry_points", lambda group: [point] if group == "spsp_ctrl.drive" else [])
    assert family("drive", "acme") is Relabelled
    assert family("drive", "cia402").__name__ == "Cia402Drive"
    with pytest.raises(UnknownFamily, match="installed: acme, cia402, odrive"):
        family("drive", "acne")
    bus = driver(drive_pitch={"family": "acne", "bus": "can0", "node": 1})
    with pytest.raises(RigError, match="no drive family 'acne'"):
        BusRig(RIG.model_copy(update={"rig": bus}), {}, {})


def test_entry_points_are_those_of_the_registry() -> None:
    project = tomllib.loads((CONFIG.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for kind, known in BUILT_IN.items():
        assert project["entry-points"][f"spsp_ctrl.{kind}"] == known
        assert all(family(kind, name) for name in known)


def test_the_lockstep_bus_is_an_interface_of_python_can(monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody's python-can program and our host on one wire: each hears the other and not itself."""
    can = pytest.importorskip("can")
    where = tomllib.loads((CONFIG.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]["can.interface"]
    monkeypatch.setitem(can.interfaces.BACKENDS, "spsp-lockstep", tuple(where["spsp-lockstep"].split(":")))
    monkeypatch.setattr(can.util, "VALID_INTERFACES", can.util.VALID_INTERFACES | {"spsp-lockstep"})
    theirs = can.Bus(interface="spsp-lockstep", channel="somewhere")
    ours = LockstepCan(medium("somewhere"))
    theirs.send(can.Message(arbitration_id=0x123, data=b"\1\2", is_extended_id=False))
    assert ours.poll(5_000_000) == [(0, 0x123, b"\1\2")]
    assert theirs.recv(0) is None
    assert ours.send([(0x80, b""), (0x201, b"abc")])
    heard = [theirs.recv(0), theirs.recv(0)]
    assert [(m.arbitration_id, bytes(m.data), m.timestamp) for m in heard if m is not None] == [(0x80, b"", 0.005), (0x201, b"abc", 0.005)]
    theirs.shutdown()
    ours.close()
