"""What the recorder hands to the writer process: frames of a head and a payload.

A head is ``<BHQII``: kind, number, log time, sequence, length of the payload. The messages of a cycle travel as one frame that already holds the MCAP
records as they lie in a chunk, so that the writer only has to note where each begins: building them one by one there cost more than the loop itself.
"""

from __future__ import annotations

import struct

from spsp_ctrl.recording.schema import CYCLIC, JSON_TOPICS, RECORD, TOPICS, packer

HEAD = "BHQII"
FRAME = struct.Struct("<" + HEAD)
MESSAGE, ATTACHMENT, METADATA, CYCLE, RAW = 0, 1, 2, 3, 4
"""Kinds. The payload of ``RAW`` is a block of ``recording.raw``, its sequence the number of entries.

``number`` is the topic of a message, the number of topics (the first of ``CYCLIC``) of a cycle, 0 otherwise."""
TOPIC_NAMES = (*CYCLIC, *JSON_TOPICS)

SIZES = tuple(RECORD.size + TOPICS[name].layout.size for name in CYCLIC)
"""Bytes of a record of each cyclic topic."""
OFFSETS = tuple(sum(SIZES[:i]) for i in range(len(SIZES)))
"""Where each begins in the frame of a cycle."""
pack_without_truth = packer(HEAD, CYCLIC[:-1])
pack_with_truth = packer(HEAD, CYCLIC)
