"""What a person sees while a session runs: the live screen in real time, a progress bar in lock-step."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments.session import Watcher
from spsp_ctrl.messages import Control, Measurement, Timing, Truth
from spsp_ctrl.report.live import LiveStatus
from spsp_ctrl.report.screen_link import ScreenLink
from spsp_ctrl.runtime.operator import PipeOperator


class _ScreenWatcher(Watcher):
    def __init__(self, link: ScreenLink, live: LiveStatus) -> None:
        self.operator = PipeOperator(link.request_fd, "screen")
        self.status = self._send
        self._link = link
        self._live = live

    def note(self, control: Control, timing: Timing) -> None:
        self._live.note(control, timing)

    def event(self, text: str, t_s: float) -> None:
        self._live.event(text, t_s)

    def degraded(self, names: str) -> None:
        self._live.degraded(names)

    def recording(self, counts: Callable[[], tuple[int, int]]) -> None:
        self._live.recording(counts)

    def _send(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        self._link.send(self._live.status(measurement, control, timing, truth))


@contextmanager
def live_screen(config: RigConfig, scenario: Scenario) -> Iterator[Watcher | None]:
    """The live screen in a process of its own; None when standard output is no terminal."""
    link = ScreenLink.start()
    if link is None:
        yield None
        return
    try:
        yield _ScreenWatcher(link, LiveStatus(config, scenario, "real-time", scenario.duration_s))
    finally:
        link.close()


class _BarWatcher(Watcher):
    def __init__(self, duration_s: float) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self.bar = Progress(
            TextColumn("simulating"),
            BarColumn(),
            TextColumn("{task.completed:.0f} of {task.total:.0f} s"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
            auto_refresh=False,
        )
        self._task = self.bar.add_task("run", total=duration_s)
        self._shown = 0.0
        self.status = self._show

    def _show(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        now = time.monotonic()
        if now - self._shown > 0.2:
            self._shown = now
            self.bar.update(self._task, completed=measurement.stamp_ns * 1e-9)
            self.bar.refresh()


@contextmanager
def progress_bar(duration_s: float) -> Iterator[Watcher | None]:
    """A progress bar on standard error; None when that is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    watcher = _BarWatcher(duration_s)
    with watcher.bar:
        yield watcher
