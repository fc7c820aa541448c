"""Is this computer ready for a rig file? Ports, permissions, kernel modules, bus load, real-time limits, disk. Opens and changes nothing."""

from __future__ import annotations

import grp
import importlib.util
import json
import os
import resource
import shutil
import stat
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from spsp_ctrl.config.devices import LOCKSTEP, BusDriver, CanBus, SerialLine
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices.transport.bus_load import LIMIT, load
from spsp_ctrl.rig.traffic import can_traffic, refusals
from spsp_ctrl.rig.wires import hardware

OK, WARN, FAIL = "ok", "warning", "FAIL"
MB = 1_000_000
LOG_MB_S = 1.0
"""A log at 1 kHz, rounded up."""


def _ip_link(channel: str) -> str:
    try:
        done = subprocess.run(["ip", "-json", "-details", "link", "show", channel], capture_output=True, text=True, check=False, timeout=2.0)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout


class Row(NamedTuple):
    """One thing looked at."""

    state: str
    what: str
    found: str
    advice: str = ""


class Host(NamedTuple):
    """Where the system's own files are; the tests have others."""

    sys: Path = Path("/sys")
    proc: Path = Path("/proc")
    by_id: Path = Path("/dev/serial/by-id")
    link: Callable[[str], str] = _ip_link
    """What `ip` says of an interface, as JSON; empty when it says nothing."""


class Controller(NamedTuple):
    """State of a CAN controller as the kernel tells it."""

    bitrate: int
    state: str
    restarts: bool
    counters: str


def _controller(text: str) -> Controller:
    """From the answer of `ip -json -details link show`; zeros and empty texts for what is not in it (vcan has none of it)."""
    try:
        data = json.loads(text)[0]["linkinfo"]["info_data"]
    except (ValueError, LookupError, TypeError):
        return Controller(0, "", False, "")
    errors = data.get("berr_counter") or {}
    counters = f" (errors: {errors['tx']} sent, {errors['rx']} received)" if "tx" in errors and "rx" in errors else ""
    bitrate = (data.get("bittiming") or {}).get("bitrate", 0)
    return Controller(int(bitrate), str(data.get("state", "")), bool(data.get("restart_ms", 0)), counters)


HERE = Host()


def preflight(config: RigConfig, runs: Path, host: Host = HERE) -> list[Row]:
    """Every row for a rig file."""
    rows: list[Row] = []
    driver = config.rig
    if isinstance(driver, BusDriver):
        for name, bus in driver.can.items():
            rows += _can(name, bus, host)
            if bus.interface != LOCKSTEP:
                share = load(can_traffic(config, name), bus.bitrate)
                rows.append(Row(OK if share <= LIMIT else FAIL, f"load of {name}", f"{100 * share:.0f} % of {bus.bitrate} bit/s, at worst"))
        for name, line in driver.serial.items():
            rows += _serial(name, line, host)
        rows += [Row(FAIL, "traffic", text) for text in refusals(config)]
        if driver.world == "served" and any(row.state == FAIL and "no such port" in row.found for row in rows):
            rows.append(Row(FAIL, "plant server", "its ports are not there", "start it in another terminal: spsp-ctrl plant serve --config FILE"))
        touched = list(hardware(driver))
        if driver.world == "hardware" and not touched:
            rows.append(Row(WARN, "world", "`hardware`, but nothing in the file is", "say `world: served` for a plant server"))
        if driver.world != "hardware":
            rows += [Row(FAIL, "world", f"{place} may be hardware", f"`world: {driver.world}` opens none") for place in touched]
    rows += _real_time(config, host)
    rows.append(_disk(runs))
    return rows


def _can(name: str, bus: CanBus, host: Host) -> Iterator[Row]:
    what = f"bus {name}"
    if bus.interface in (LOCKSTEP, "virtual"):
        yield Row(OK, what, f"{bus.interface}, in this process")
    elif bus.interface == "udp_multicast":
        there = importlib.util.find_spec("msgpack") is not None
        yield Row(OK if there else FAIL, what, f"udp_multicast {bus.channel}", "" if there else "pip install msgpack")
    elif bus.interface == "slcan":
        yield from _port(what, bus.channel.partition("@")[0], host)
    elif bus.interface == "socketcan":
        yield from _socketcan(what, bus, host)
    else:
        known = _known_interface(bus.interface)
        yield Row(OK if known else FAIL, what, f"{bus.interface} {bus.channel}", "" if known else "python-can knows no interface of that name")


def _known_interface(name: str) -> bool:
    import can

    return name in can.VALID_INTERFACES


def _socketcan(what: str, bus: CanBus, host: Host) -> Iterator[Row]:
    missing = [m for m in ("can", "can_raw") if not (host.sys / "module" / m).exists()]
    if missing:
        yield Row(FAIL, what, f"kernel modules not loaded: {', '.join(missing)}", f"sudo modprobe {' '.join(missing)}")
        return
    folder = host.sys / "class" / "net" / bus.channel
    if not folder.exists():
        others = sorted(p.name for p in (host.sys / "class" / "net").glob("*can*"))
        there = f"; there are {', '.join(others)}" if others else ""
        yield Row(FAIL, what, f"no interface {bus.channel}{there}", "ip link; is the adapter plugged in?")
        return
    flags = int(_text(folder / "flags") or "0", 16)
    if not flags & 1:
        yield Row(FAIL, what, f"{bus.channel} is down", f"sudo ip link set {bus.channel} up type can bitrate {bus.bitrate} restart-ms 100")
        return
    controller = _controller(host.link(bus.channel))
    if controller.bitrate and controller.bitrate != bus.bitrate:
        found = f"{bus.channel} runs at {controller.bitrate} bit/s, the rig file says {bus.bitrate}"
        yield Row(FAIL, what, found, f"sudo ip link set {bus.channel} down; sudo ip link set {bus.channel} up type can bitrate {bus.bitrate}")
        return
    if controller.state in ("BUS-OFF", "ERROR-PASSIVE", "STOPPED"):
        yield Row(FAIL, what, f"{bus.channel} is {controller.state}{controller.counters}", "termination, bit rate of the other nodes, cable")
        return
    if controller.bitrate and not controller.restarts:
        advice = f"sudo ip link set {bus.channel} type can restart-ms 100"
        yield Row(WARN, what, f"{bus.channel} does not come back by itself after bus-off", advice)
    queue = int(_text(folder / "tx_queue_len") or "0")
    advice = f"sudo ip link set {bus.channel} txqueuelen 100" if queue < 50 else ""
    yield Row(WARN if queue < 50 else OK, what, f"socketcan {bus.channel}, up, send queue {queue}", advice)


def _serial(name: str, line: SerialLine, host: Host) -> Iterator[Row]:
    if line.port == LOCKSTEP:
        yield Row(OK, f"line {name}", f"{LOCKSTEP}, in this process")
        return
    yield from _port(f"line {name}", line.port, host)


def _port(what: str, port: str, host: Host) -> Iterator[Row]:
    path = Path(port)
    try:
        found = path.stat()
    except FileNotFoundError:
        there = ", ".join(sorted(str(p) for p in host.by_id.glob("*"))) if host.by_id.is_dir() else ""
        yield Row(FAIL, what, f"{port}: no such port", f"there are {there}" if there else "no serial adapter is plugged in")
        return
    except OSError as error:
        yield Row(FAIL, what, f"{port}: {error.strerror}")
        return
    if not stat.S_ISCHR(found.st_mode):
        yield Row(FAIL, what, f"{port} is no serial port")
        return
    if not os.access(path, os.R_OK | os.W_OK):
        try:
            group = grp.getgrgid(found.st_gid).gr_name
        except KeyError:
            group = str(found.st_gid)
        yield Row(FAIL, what, f"{port}: no permission", f"sudo usermod -aG {group} $USER, then log in again")
        return
    real = os.path.realpath(port)
    timer = _text(host.sys / "class" / "tty" / os.path.basename(real) / "device" / "latency_timer")
    if timer and int(timer) > 1:
        yield Row(WARN, what, f"{port}, its adapter holds bytes back for {timer} ms", "the udev rule of hil/ sets 1 ms; a run sets it where it may")
        return
    if port.startswith(("/dev/ttyUSB", "/dev/ttyACM")):
        yield Row(WARN, what, f"{port}, may be another device after the next start", "a name of /dev/serial/by-id or a udev rule stays")
        return
    yield Row(OK, what, port)


def _real_time(config: RigConfig, host: Host) -> Iterator[Row]:
    if not config.realtime.enabled:
        return
    wanted = config.realtime.priority
    _, hard = resource.getrlimit(resource.RLIMIT_RTPRIO)
    root = os.geteuid() == 0
    granted = root or hard == resource.RLIM_INFINITY or hard >= wanted
    yield Row(
        OK if granted else WARN,
        "real-time priority",
        "allowed (root)" if root else f"limit {hard if hard >= 0 else 'none'}, wanted {wanted}",
        "" if granted else f"/etc/security/limits.d/90-spsp.conf: @realtime - rtprio {wanted}, and join the group",
    )
    _, locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    enough = root or locked == resource.RLIM_INFINITY or locked >= 512 * MB
    found = "unlimited" if locked == resource.RLIM_INFINITY else f"{locked // MB} MB"
    yield Row(OK if enough else WARN, "locked memory", found, "" if enough else "/etc/security/limits.d/90-spsp.conf: @realtime - memlock unlimited")
    governors = {_text(p) for p in (host.sys / "devices" / "system" / "cpu").glob("cpu*/cpufreq/scaling_governor")}
    if governors:
        slow = governors - {"performance"}
        yield Row(WARN if slow else OK, "CPU governor", ", ".join(sorted(governors)), "sudo cpupower frequency-set -g performance" if slow else "")
    kernel = "PREEMPT_RT" if _text(host.sys / "kernel" / "realtime") == "1" else "not PREEMPT_RT"
    yield Row(OK, "kernel", f"{os.uname().release}, {kernel}")
    share = _text(host.proc / "sys" / "kernel" / "sched_rt_runtime_us")
    yield Row(OK, "real-time share", "unlimited" if share == "-1" else f"{int(share or 950000) / 1e4:.0f} % of each second")


def _disk(runs: Path) -> Row:
    folder = runs
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not os.access(folder, os.W_OK):
        return Row(FAIL, "disk", f"{folder}: not writable", "run from another folder, or give --out")
    free = shutil.disk_usage(folder).free / MB
    hours = free / LOG_MB_S / 3600
    state = FAIL if free < 100 else WARN if hours < 1 else OK
    return Row(state, "disk", f"{free / 1000:.1f} GB free under {folder}, {hours:.0f} h of log", "" if state == OK else "make room")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
