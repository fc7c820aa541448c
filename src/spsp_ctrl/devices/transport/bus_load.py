"""How much of a CAN bus its traffic takes, with the worst bit stuffing. No I/O."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor
from typing import NamedTuple

LIMIT = 0.8
"""Above this a bus is refused: what is left is for start-up, emergencies and repeated frames."""


class Traffic(NamedTuple):
    """One kind of frame on a bus."""

    name: str
    data_bytes: int
    per_s: float
    extended: bool = False
    cyclic: bool = False
    """Its rate is that of the control loop."""


def worst_bits(data_bytes: int, extended: bool = False) -> int:
    """Bits of a frame with every stuff bit that can occur, and the three of the pause after it (ISO 11898-1; Davis et al. 2007, eq. 1)."""
    stuffed = (54 if extended else 34) + 8 * data_bytes
    return stuffed + 13 + (stuffed - 1) // 4


def load(traffic: Sequence[Traffic], bitrate: int) -> float:
    """Share of the bus that is taken."""
    return sum(t.per_s * worst_bits(t.data_bytes, t.extended) for t in traffic) / bitrate


def refusal(bus: str, traffic: Sequence[Traffic], bitrate: int, rate_hz: int) -> str:
    """Why a bus cannot carry its traffic and what to change; empty when it can."""
    share = load(traffic, bitrate)
    if share <= LIMIT:
        return ""
    parts = sorted(traffic, key=lambda t: -t.per_s * worst_bits(t.data_bytes, t.extended))
    biggest = ", ".join(f"{t.name} {100 * load([t], bitrate):.0f} %" for t in parts[:3])
    cyclic = load([t for t in traffic if t.cyclic], bitrate)
    other = share - cyclic
    ways = []
    lower = floor(rate_hz * (LIMIT - other) / cyclic) if cyclic and other < LIMIT else 0
    if lower >= 100:
        ways.append(f"rate_hz {lower} or less (now {rate_hz})")
    faster = next((b for b in (125_000, 250_000, 500_000, 800_000, 1_000_000) if load(traffic, b) <= LIMIT), None)
    if faster:
        ways.append(f"rig.can.{bus}.bitrate {faster} (now {bitrate})")
    if len(parts) > 2:
        ways.append(f"{parts[0].name.split(':')[0]} on a second bus")
    found = f"{100 * share:.0f} % of {bitrate} bit/s with the worst stuffing, allowed {100 * LIMIT:.0f} %"
    return f"rig.can.{bus}: {found} ({biggest}); change one: {'; or '.join(ways) or 'another bus for most of it'}"
