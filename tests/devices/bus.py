"""A bus without wires for the tests: frames go from one side to the other in order."""

from __future__ import annotations

from collections.abc import Callable, Iterable

Frame = tuple[int, bytes]


def exchange(frames: Iterable[Frame], receive: Callable[[Frame], list[Frame]]) -> list[Frame]:
    """Hand frames to a node; what it sends back."""
    return [answer for frame in frames for answer in receive(frame)]


def talk(step: Callable[[int, list[Frame]], list[Frame]], receive: Callable[[Frame], list[Frame]], ended: Callable[[], bool]) -> None:
    """Run a dialogue against a node until it ends (10 ms a turn)."""
    heard: list[Frame] = []
    for turn in range(500):
        heard = exchange(step(turn * 10_000_000, heard), receive)
        if ended():
            return
    raise AssertionError("the dialogue does not end")
