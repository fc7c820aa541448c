"""The ledger: JSON lines that are only ever appended; a case is run once for a commit and its settings."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def commit_of(tree: Path) -> str:
    """Commit of the code under exam; changes that are not committed add their digest, so that they are never pooled with it."""

    def git(*words: str) -> str:
        return subprocess.run(["git", "-C", str(tree), *words], capture_output=True, text=True, check=False).stdout

    head, change = git("rev-parse", "--short=12", "HEAD").strip() or "no-git", git("diff", "HEAD", "--", ".")
    return f"{head}+{hashlib.sha256(change.encode()).hexdigest()[:8]}" if change else head


def settings_of(values: dict[str, Any]) -> str:
    """Digest of what a result depends on besides case and commit."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


class Ledger:
    """Rows of one file. A torn last line, as a killed run leaves it, is skipped and the case run again."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.rows: list[dict[str, Any]] = []
        self.torn = 0
        if path.exists():
            text = path.read_text(encoding="utf-8")
            for line in text.splitlines():
                try:
                    self.rows.append(json.loads(line))
                except ValueError:
                    self.torn += 1
            if text and not text.endswith("\n"):
                with path.open("a", encoding="utf-8") as stream:
                    stream.write("\n")

    def append(self, row: dict[str, Any]) -> None:
        """One row, on disk when this returns."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row, sort_keys=True) + "\n")
            stream.flush()
            os.fsync(stream.fileno())
        self.rows.append(row)

    def has(self, commit: str, case: str, settings: str) -> bool:
        """Whether this case was run already with this code and these settings."""
        return any((r["commit"], r["case"], r["settings"]) == (commit, case, settings) for r in self.rows)

    def of(self, commit: str, settings: str, cases: Iterable[str] | None = None) -> list[dict[str, Any]]:
        """Rows of one commit and one setting, the last of each case."""
        wanted = None if cases is None else set(cases)
        latest = {r["case"]: r for r in self.rows if r["commit"] == commit and r["settings"] == settings and (wanted is None or r["case"] in wanted)}
        return [latest[name] for name in sorted(latest)]
