"""CiA 406 encoder or resolver node, the master's side."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import cia406_table as T
from spsp_ctrl.devices.canopen_host import Frame, Setting, map_pdo
from spsp_ctrl.messages import ResolverStatus

_ANGLE = struct.Struct(T.ANGLE_LAYOUT)
_FAULTS = (
    (T.LOSS_OF_SIGNAL, ResolverStatus.LOSS_OF_SIGNAL),
    (T.DEGRADATION, ResolverStatus.DEGRADATION),
    (T.LOSS_OF_TRACKING, ResolverStatus.LOSS_OF_TRACKING),
)


class AngleReading(NamedTuple):
    """What a node sends after each SYNC."""

    position: int
    """Counts within the range of the node; ``canopen_host.Counter`` unrolls it."""
    speed: int
    """In the node's own unit."""
    status: int
    """Fault bits as ``messages.ResolverStatus``; 0 is good."""


def read_angle(frame: Frame, node: int) -> AngleReading | None:
    """Reading of a node, None for any other frame."""
    identifier, data = frame
    if identifier != C.TPDO1 + node or len(data) != _ANGLE.size:
        return None
    position, speed, word = _ANGLE.unpack(data)
    return AngleReading(position, speed, sum(int(flag) for bit, flag in _FAULTS if word & bit))


def start_up(node: int, heartbeat_ms: int) -> Iterator[Setting]:
    """Everything that a node is told and asked before NMT start."""
    yield Setting(C.DEVICE_TYPE, 0, None, 4)
    for subindex in (1, 2, 3, 4):
        yield Setting(C.IDENTITY, subindex, None, 4)
    yield Setting(T.UNITS_PER_TURN, 0, None, 4)
    yield Setting(T.TOTAL_RANGE, 0, None, 4)
    yield from map_pdo(C.TPDO_SETTINGS, C.TPDO_MAPPING, C.TPDO1 + node, 1, T.ANGLE_PDO)
    yield Setting(C.PRODUCER_HEARTBEAT, 0, heartbeat_ms, 2)


def is_encoder(device_type: int) -> bool:
    """Whether object 0x1000 names the profile 406."""
    return device_type & 0xFFFF == 406
