"""What of a machine decides about punctuality, read from ``/proc`` and ``/sys``, and what to do about it."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path("/")
STEAL_SHARE = 0.002
LOAD_PER_CORE = 0.7


class Machine(NamedTuple):
    """Facts; None where the system does not say."""

    kernel: str
    preempt_rt: bool
    virtual: bool
    cores: int
    isolated: str
    """Cores kept free of other programs (``isolcpus``), as the kernel lists them."""
    governor: str | None
    clocksource: str | None
    throttled_us: int | None
    """Microseconds of each second that real-time tasks may use; -1 for all."""
    load_1min: float


def look(cpu: int, root: Path = ROOT) -> Machine:
    """Facts about the machine and one of its cores."""
    release = _text(root / "proc/version") or platform.version()
    runtime = _text(root / "proc/sys/kernel/sched_rt_runtime_us")
    return Machine(
        kernel=platform.release(),
        preempt_rt=_text(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in release,
        virtual=" hypervisor" in (_text(root / "proc/cpuinfo") or ""),
        cores=os.cpu_count() or 1,
        isolated=_text(root / "sys/devices/system/cpu/isolated") or "",
        governor=_text(root / f"sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor"),
        clocksource=_text(root / "sys/devices/system/clocksource/clocksource0/current_clocksource"),
        throttled_us=int(runtime) if runtime and runtime.lstrip("-").isdigit() else None,
        load_1min=os.getloadavg()[0],
    )


def cpu_times(cpu: int, root: Path = ROOT) -> tuple[int, int]:
    """Stolen and total time of a core in ticks: what a host has taken from a virtual machine."""
    for line in (_text(root / "proc/stat") or "").splitlines():
        fields = line.split()
        if fields and fields[0] == f"cpu{cpu}":
            ticks = [int(f) for f in fields[1:9]]
            return (ticks[7] if len(ticks) > 7 else 0), sum(ticks)
    return 0, 0


def advice(machine: Machine, cpu: int, refused: Mapping[str, str], stolen_share: float) -> list[dict[str, str]]:
    """What to change, the most worthwhile first: what was seen, and what to do."""
    found: list[dict[str, str]] = []

    def add(about: str, seen: str, do: str) -> None:
        found.append({"about": about, "seen": seen, "do": do})

    if "fifo" in refused:
        add("priority", f"SCHED_FIFO {refused['fifo']}",
            "allow it: `@realtime - rtprio 90` in /etc/security/limits.conf and log in again, or LimitRTPRIO=90 in the systemd unit")  # fmt: skip
    if "memory_locked" in refused:
        add("memory", f"mlockall {refused['memory_locked']}", "allow it: `@realtime - memlock unlimited` in limits.conf, or LimitMEMLOCK=infinity")
    if "cpu_dma_latency" in refused:
        add("sleep states", f"/dev/cpu_dma_latency {refused['cpu_dma_latency']}",
            "a udev rule: KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\"; or boot with processor.max_cstate=1")  # fmt: skip
    if "cpu" in refused:
        add("core", f"core {cpu} {refused['cpu']}", "choose a core that exists and that this session may use (realtime.cpu in the rig file)")
    if machine.load_1min > LOAD_PER_CORE * machine.cores:
        add("load", f"load average {machine.load_1min:.1f} on {machine.cores} cores", "stop what else runs, or isolate a core for the loop")
    if machine.governor is not None and machine.governor != "performance":
        add("governor", f"core {cpu} runs with the governor {machine.governor}", f"cpupower -c {cpu} frequency-set -g performance")
    if machine.cores > 1 and not machine.isolated:
        add("isolcpus", "no core is kept free of other programs",
            f"boot with isolcpus={cpu} nohz_full={cpu} rcu_nocbs={cpu} and set realtime.cpu: {cpu} in the rig file")  # fmt: skip
    if not machine.preempt_rt:
        add("PREEMPT_RT", f"kernel {machine.kernel} is not fully preemptible", "install a PREEMPT_RT kernel (Debian: linux-image-rt-amd64)")
    if machine.virtual:
        seen = f"a virtual machine; its host took {100.0 * stolen_share:.2f} % of core {cpu} during the test"
        add("host", seen, "pauses made by the host cannot be cured inside: pin the virtual processors, or use a real machine for hardware"
            if stolen_share <= STEAL_SHARE else "the host takes time away: nothing inside helps, use a real machine for hardware")  # fmt: skip
    if machine.clocksource is not None and machine.clocksource not in ("tsc", "kvm-clock", "arch_sys_counter"):
        add("clock", f"clock source {machine.clocksource} is slow to read", "check the kernel's log for why tsc was given up")
    return found


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None
