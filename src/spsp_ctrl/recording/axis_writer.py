"""The log of a single axis: samples on ``/axis``, the motions as events, the files of the session as attachments.

Written in this process: a virtual axis has no deadline, and a bench at its 500 Hz leaves the time. Same samples, same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType

from spsp_ctrl import __version__
from spsp_ctrl.messages import AxisSample
from spsp_ctrl.recording.schema import JSON_TOPICS, TOPICS
from spsp_ctrl.recording.writer_process import McapLog

CONTROLLERS = ("none", "recorded", "cascade")
"""What made the commands: nobody or a motion in velocity mode, something unknown that is taken as recorded, the known cascade."""
_CODEC = TOPICS["/axis"]
_AXIS, _EVENTS = 0, 1 + list(JSON_TOPICS).index("/events")


class AxisLog:
    """Writes ``path``; a context manager, so that the index is written whatever happens.

    ``rate_hz`` is the rate of the samples, ``controller`` one of ``CONTROLLERS``, ``run`` further facts. Raises ``OSError`` when the file cannot be
    written and ``ValueError`` for an unknown controller.
    """

    def __init__(
        self,
        path: Path,
        *,
        rate_hz: float,
        controller: str,
        attachments: Mapping[str, str] | None = None,
        run: Mapping[str, str] | None = None,
    ) -> None:
        if controller not in CONTROLLERS:
            raise ValueError(f"controller {controller!r} is none of {', '.join(CONTROLLERS)}")
        self._stream = path.open("wb")
        self._log = McapLog(self._stream, ("/axis",))
        self._samples = self._events = 0
        for name, text in (attachments or {}).items():
            self._log.attachment(name, text.encode())
        self._log.metadata("run", {"kind": "axis", "rate_hz": f"{rate_hz:g}", "controller": controller, **(run or {})})
        self._log.metadata("versions", {"spsp_ctrl": __version__})

    def sample(self, sample: AxisSample) -> None:
        """One cycle."""
        self._log.message(_AXIS, sample.stamp_ns, self._samples, _CODEC.encode(sample))
        self._samples += 1

    def samples(self, samples: Iterable[AxisSample]) -> None:
        """Many cycles, in the order of time."""
        for sample in samples:
            self.sample(sample)

    def motion(self, stamp_ns: int, name: str) -> None:
        """A motion begins at the sample of ``stamp_ns``; it lasts until the next one begins."""
        self.event(stamp_ns, "info", "motion", name)

    def event(self, stamp_ns: int, level: str, id: str, text: str) -> None:
        """Something happened."""
        payload = json.dumps({"stamp_ns": stamp_ns, "level": level, "id": id, "text": text}).encode()
        self._log.message(_EVENTS, max(stamp_ns, 0), self._events, payload)
        self._events += 1

    def close(self) -> None:
        """Write the index."""
        if not self._stream.closed:
            self._log.finish()
            self._stream.close()

    def __enter__(self) -> AxisLog:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
