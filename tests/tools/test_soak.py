"""The soak: 30 minutes with ``-m soak``, a few seconds in every run of the tests. And its judge sees what is wrong."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from tools.bench import soak

SHORT_S, LONG_S = 5.0, 1800.0


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return soak.soak(SHORT_S, tmp_path_factory.mktemp("soak"), workers=1)


def test_a_short_soak_is_clean(short: dict[str, Any]) -> None:
    """But for memory, which is only steady after a while, all that the long one must hold."""
    assert [text for text in short["wrong"] if not text.startswith("memory")] == []
    assert short["log"]["messages"]["/control"] == short["cycles"] > SHORT_S * 500


@pytest.mark.parametrize(
    ("path", "value", "word"),
    [
        (("ended",), "fault: x", "ended"),
        (("lost",), 3, "lost"),
        (("records",), 1, "records"),
        (("skipped",), 77, "skipped"),
        (("log", "problem"), "cut", "the log"),
        (("log", "gaps"), 1, "gaps"),
        (("log", "out_of_order"), 1, "out of order"),
        (("log", "messages", "/truth"), 5, "messages"),
        (("log", "last_cycle"), 100, "last cycle"),
        (("growth_kib", "log writer"), 2000.0, "memory"),
        (("active_looks",), 0, "ACTIVE"),
    ],
)
def test_the_judge_sees_it(short: dict[str, Any], path: tuple[str, ...], value: object, word: str) -> None:
    figures = copy.deepcopy(short)
    place = figures
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    assert any(word in text for text in soak.judge(figures, SHORT_S, 1000))


@pytest.mark.soak
def test_half_an_hour(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if "soak" not in request.config.getoption("markexpr"):
        pytest.skip("takes half an hour: pytest -m soak")
    figures = soak.soak(LONG_S, tmp_path, workers=2)
    assert figures["wrong"] == []
