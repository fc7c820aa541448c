"""Damage as lines and buses do it. Everything is drawn from one seeded generator, so a finding is found again."""

from __future__ import annotations

from random import Random

Frame = tuple[int, bytes]


def damaged(rng: Random, data: bytes) -> bytes:
    """Bytes with one to four faults: a flipped bit, another byte, a lost one, one too many, a cut, a repeated piece, a burst."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(found) + 1)
        kind = rng.randrange(7)
        if kind == 0 and at < len(found):
            found[at] ^= 1 << rng.randrange(8)
        elif kind == 1 and at < len(found):
            found[at] = rng.randrange(256)
        elif kind == 2 and at < len(found):
            del found[at]
        elif kind == 3:
            found.insert(at, rng.randrange(256))
        elif kind == 4:
            del found[at:]
        elif kind == 5:
            found[at:at] = found[at : at + rng.randint(1, 8)]
        else:
            found[at : at + rng.randint(1, 6)] = rng.randbytes(rng.randint(1, 6))
    return bytes(found)


def frame(rng: Random, identifier: int, size: int) -> Frame:
    """A frame near the right one: its identifier right, off by a bit, or any; its length right or any; its data any, of few bits, or extreme."""
    kind = rng.random()
    number = identifier if kind < 0.5 else identifier ^ 1 << rng.randrange(11) if kind < 0.8 else rng.randrange(0x800)
    length = size if rng.random() < 0.6 else rng.randrange(9)
    kind = rng.random()
    if kind < 0.7:
        data = rng.randbytes(length)
    else:
        data = bytes(length) if kind < 0.8 else b"\xff" * length if kind < 0.9 else bytes(1 << rng.randrange(8) for _ in range(length))
    return number, data
