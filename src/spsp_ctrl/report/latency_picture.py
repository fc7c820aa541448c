"""Picture of a latency test: histogram of the lateness of the loop and of ``cyclictest``, both axes logarithmic, with the bands of the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape

WIDTH, HEIGHT = 900, 420
LEFT, RIGHT, TOP, BOTTOM = 70, 20, 46, 54
LEAST_US = 0.01
PER_DECADE = 12
_STYLE = (
    "text{font:13px system-ui,sans-serif;fill:#333}.t{font-size:15px;font-weight:600}.g{stroke:#ddd;fill:none}.f{stroke:#888;fill:none}"
    ".own{fill:#1668b3;fill-opacity:.35;stroke:#1668b3;stroke-width:1.5}.other{fill:none;stroke:#c2571a;stroke-width:1.8}"
    ".m{stroke:#333;stroke-dasharray:5 4;fill:none}.good{fill:#2e9e5b;fill-opacity:.09}.usable{fill:#e0a800;fill-opacity:.11}"
)


def bins(values: Mapping[float, int]) -> dict[int, int]:
    """Counts by logarithmic bin; bin ``k`` begins at ``10 ** (k / PER_DECADE)`` us. What is below ``LEAST_US`` stands in its bin."""
    found: dict[int, int] = {}
    for value, count in values.items():
        k = math.floor(math.log10(max(value, LEAST_US)) * PER_DECADE + 1e-9)
        found[k] = found.get(k, 0) + count
    return found


def picture(
    title: str,
    own: Mapping[float, int],
    other: Mapping[float, int] | None,
    period_us: float,
    good_us: float,
    usable_us: float,
) -> str:
    """``own`` and ``other`` count wake-ups by lateness in us; ``other`` is None where ``cyclictest`` was not there."""
    series = [("own", "loop of spsp-ctrl", bins(own))]
    if other:
        series.append(("other", "cyclictest", bins({us + 0.5: n for us, n in other.items()})))
    ks = [k for _, _, counts in series for k in counts] or [0]
    low = math.floor(min(ks) / PER_DECADE)
    high = math.ceil(max(max(ks) + 1, math.log10(period_us) * PER_DECADE + 1) / PER_DECADE)
    top = math.ceil(math.log10(max(max(counts.values(), default=1) for _, _, counts in series)) + 0.15)
    wide, tall = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def x(decades: float) -> float:
        return LEFT + wide * min(1.0, max(0.0, (decades - low) / (high - low)))

    def y(count: float) -> float:
        # half a decade below 1 carries the bins that hold a single wake-up
        return TOP + tall * (1.0 - (math.log10(max(count, 10**-0.5)) + 0.5) / (top + 0.5))

    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}"><style>{_STYLE}</style>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/><text class="t" x="{LEFT}" y="22">{escape(title)}</text>',
    ]
    good, usable = x(math.log10(good_us)), x(math.log10(usable_us))
    out.append(f'<rect class="good" x="{LEFT}" y="{TOP}" width="{good - LEFT:.1f}" height="{tall}"/>')
    out.append(f'<rect class="usable" x="{good:.1f}" y="{TOP}" width="{usable - good:.1f}" height="{tall}"/>')
    for k in range(low, high + 1):
        out.append(f'<path class="g" d="M{x(k):.1f} {TOP}v{tall}"/><text x="{x(k):.1f}" y="{HEIGHT - 34}" text-anchor="middle">{10.0**k:g}</text>')
    for k in range(top + 1):
        out.append(f'<path class="g" d="M{LEFT} {y(10**k):.1f}h{wide}"/>')
        out.append(f'<text x="{LEFT - 8}" y="{y(10**k) + 4:.1f}" text-anchor="end">{10**k:g}</text>')
    for cls, _, counts in series:
        base = TOP + tall
        path = f"M{LEFT} {base}"
        for k in range(low * PER_DECADE, high * PER_DECADE):
            height = y(counts[k]) if k in counts else base
            path += f"V{height:.1f}H{x((k + 1) / PER_DECADE):.1f}"
        out.append(f'<path class="{cls}" d="{path}V{base}"/>')
    at = x(math.log10(period_us))
    out.append(f'<path class="m" d="M{at:.1f} {TOP}v{tall}"/><text x="{at:.1f}" y="{TOP - 6}" text-anchor="middle">period</text>')
    out.append(f'<text x="{(LEFT + good) / 2:.1f}" y="{TOP - 6}" text-anchor="middle">p99: good</text>')
    out.append(f'<text x="{(good + usable) / 2:.1f}" y="{TOP - 6}" text-anchor="middle">usable</text>')
    out.append(f'<rect class="f" x="{LEFT}" y="{TOP}" width="{wide}" height="{tall}"/>')
    caption = "lateness of the wake-up, µs (number of cycles upwards)"
    out.append(f'<text x="{LEFT + wide / 2:.1f}" y="{HEIGHT - 12}" text-anchor="middle">{caption}</text>')
    for i, (cls, name, _) in enumerate(series):
        out.append(f'<rect class="{cls}" x="{WIDTH - 300 + 165 * i}" y="12" width="22" height="9"/>')
        out.append(f'<text x="{WIDTH - 272 + 165 * i}" y="21">{name}</text>')
    return "".join(out) + "</svg>\n"
