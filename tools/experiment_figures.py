"""Put the figures of a run of `spsp-ctrl experiment all` into docs/experiments.md.

    spsp-ctrl experiment all --no-logs --out runs/all
    python -m tools.experiment_figures runs/all/summary.json

Only the value columns of the tables are rewritten; the sentences around them are for a person to keep true.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parents[1] / "docs" / "experiments.md"
LAWS = ("cascade", "stabiliser")


def shown(row: dict[str, Any], law: str) -> str:
    """One cell: three digits, a cross where the bound is missed, nothing where the law was not run."""
    verdict = row["by_law"].get(law)
    if verdict is None:
        return ""
    text = "–" if verdict["value"] is None else f"{verdict['value']:#.3g}".rstrip(".")
    return text if verdict["passed"] else f"{text} ✗"


def main() -> None:
    """Entry point."""
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m tools.experiment_figures runs/all/summary.json")
    experiments = {e["experiment"]: e for e in json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["experiments"]}
    rows: dict[str, dict[str, Any]] = {}
    columns: list[str] = []
    lines = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("### "):
            rows = {row["name"]: row for row in experiments.get(line[4:].split(":")[0], {"acceptance": []})["acceptance"]}
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        if cells and cells[0] == "row":
            columns = cells
        elif cells and cells[0] in rows:
            row = rows[cells[0]]
            line = "| " + " | ".join(shown(row, c) if c in LAWS else cell for c, cell in zip(columns, cells, strict=True)) + " |"
        lines.append(line)
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    met = [row["pass"] for e in experiments.values() for row in e["acceptance"]]
    print(f"{PAGE.name}: {sum(met)} of {len(met)} rows met")


if __name__ == "__main__":
    main()
