"""A short fire at every decoder and every simulated device; ``SPSP_CTRL_FUZZ=1000000 pytest -m fuzz`` or ``python -m tools.fuzz`` is the long one."""

from __future__ import annotations

import os
from random import Random

import pytest

from tools.fuzz.__main__ import fire
from tools.fuzz.devices import device_targets
from tools.fuzz.hosts import EXPECTED, Target, accepted, host_targets
from tools.fuzz.mutate import damaged

SHOTS = int(os.environ.get("SPSP_CTRL_FUZZ", "1500"))
STREAM = 0.02
"""Messages that a mutant may swallow: those whose bytes end it by chance."""


@pytest.mark.fuzz
@pytest.mark.parametrize("target", [*host_targets(), *device_targets()], ids=lambda t: t.name)
def test_nothing_escapes_and_nothing_wrong_comes_out(target: Target) -> None:
    assert fire(target, SHOTS, seed=2) == 0
    assert target.count["wrong"] == 0, target.count
    # resynchronisation within one packet: of two good ones after a mutant the second always arrives
    assert target.count["both lost"] == 0
    assert target.count["lost"] <= STREAM * SHOTS
    assert target.count["samples"] + target.count["ended"] > 0, "the fire hits nothing: it proves nothing"


@pytest.mark.fuzz
@pytest.mark.parametrize("kind", EXPECTED)
def test_content_by_chance_passes_as_often_as_the_checksum_lets_it(kind: str) -> None:
    shots = max(SHOTS, 200_000 if kind == "mip" else 20_000)
    mean = shots * EXPECTED[kind]
    assert abs(accepted(kind, shots, seed=5) - mean) < 5.0 * mean**0.5


def test_a_decoder_that_takes_anything_is_found() -> None:
    """The judge of the fire is awake."""
    from tools.fuzz.hosts import FrameDecoder

    loose = FrameDecoder("loose", lambda f: f if len(f[1]) == 8 else None, 0x185, (8,), True)
    fire(loose, 200, seed=1)
    assert loose.count["wrong"] > 10

    class Raises(Target):
        name = "raises"

        def shot(self, rng: Random) -> None:
            if rng.random() < 0.5:
                raise IndexError

    assert 20 < fire(Raises(), 100, seed=1) < 80


def test_damage_is_damage() -> None:
    rng, data = Random(1), bytes(range(40))
    assert sum(damaged(rng, data) != data for _ in range(200)) > 190
