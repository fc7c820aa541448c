"""Answers under seal: the digest is published before the subject runs, the answer is opened only when its diagnosis is on disk."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any


class SealError(Exception):
    """The order of the exam was not kept."""


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def seal(folder: Path, name: str, answer: dict[str, Any], salt: str) -> str:
    """Write the sealed answer and publish its digest in ``published.jsonl``; the salt keeps the few possible answers from being tried out."""
    (folder / "sealed").mkdir(parents=True, exist_ok=True)
    text = json.dumps({"salt": salt, "answer": answer}, sort_keys=True)
    digest = _digest(text)
    with (folder / "published.jsonl").open("a", encoding="utf-8") as stream:
        stream.write(json.dumps({"case": name, "sha256": digest}) + "\n")
        stream.flush()
        os.fsync(stream.fileno())
    (folder / "sealed" / f"{name}.json").write_text(text, encoding="utf-8")
    return digest


def unseal(folder: Path, name: str, diagnosis: Path) -> dict[str, Any]:
    """The answer, once the diagnosis exists; raises ``SealError`` before, and when the file is not the one that was published."""
    if not diagnosis.exists():
        raise SealError(f"{name}: no diagnosis yet, the answer stays sealed")
    text = (folder / "sealed" / f"{name}.json").read_text(encoding="utf-8")
    published = [row for row in map(json.loads, (folder / "published.jsonl").read_text(encoding="utf-8").splitlines()) if row["case"] == name]
    if not published or published[-1]["sha256"] != _digest(text):
        raise SealError(f"{name}: the answer is not the one whose digest was published")
    answer: dict[str, Any] = json.loads(text)["answer"]
    return answer
