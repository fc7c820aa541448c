"""The committed pages say what the code says, and every field, index and exit code has its words."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_type_hints

import pytest

from spsp_ctrl.plant.layout import COMMAND, SENSED, WORK
from spsp_ctrl.recording.schema import TOPICS
from tools import doc_words, make_docs
from tools.doc_fields import unit_of

PAGES = sorted(make_docs.DOCS.glob("*.md"))


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.name)
def test_page_is_up_to_date(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    fresh, changed = make_docs.render(text)
    assert not changed, "run python -m tools.make_docs"
    assert fresh == text
    assert text.count("<!-- generated:") == len(make_docs.MARKER.findall(text)) == text.count("<!-- end -->")


def test_a_stale_table_is_noticed() -> None:
    text = "before\n<!-- generated: faults -->\n| old |\n<!-- end -->\nafter\n"
    fresh, changed = make_docs.render(text)
    assert changed == ["faults"]
    assert fresh.startswith("before\n")
    assert fresh.endswith("after\n")
    assert "| old |" not in fresh
    assert "`imu-stale`" in fresh


def test_every_generator_is_on_a_page() -> None:
    used = {name for path in PAGES for _, name, _ in make_docs.MARKER.findall(path.read_text(encoding="utf-8"))}
    assert used == make_docs.GENERATORS.keys()


def test_every_message_field_has_a_meaning() -> None:
    seen: list[type] = []
    for codec in TOPICS.values():
        make_docs.message_classes(codec.cls, seen)
    missing = [f"{c.__name__}.{n}" for c in seen for n in get_type_hints(c) if not make_docs.field_meaning(c, n)]
    assert not missing, "give it a docstring in messages.py or words in tools/doc_words.py"
    known = {f"{c.__name__}.{n}" for c in seen for n in get_type_hints(c)}
    gone = {k for k in doc_words.FIELDS if "." in k and not k.startswith("/")} - known
    assert not gone, "words for fields that no longer exist"


def test_words_cover_the_layout_exactly() -> None:
    assert doc_words.INNER.keys() == set(COMMAND)
    assert doc_words.RIG_OUTPUTS.keys() == set(SENSED)
    assert doc_words.WORKING.keys() == set(WORK)


def test_units_come_from_the_longest_ending() -> None:
    assert [unit_of(n) for n in ("a_rad_s2", "b_m_s", "kp_a_s_rad", "rod_m", "x_deg_s", "seq")] == ["rad/s²", "m/s", "A s/rad", "m", "°/s", ""]


def test_links_between_pages_hold() -> None:
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        anchors = {re.sub(r"[^\w -]", "", h).strip().lower().replace(" ", "-") for h in re.findall(r"^#+ (.*)$", text, re.M)}
        for target in re.findall(r"\]\(([^)]+)\)", text):
            if target.startswith("#"):
                assert target[1:] in anchors, f"{path.name}: {target}"
            elif not target.startswith("http"):
                assert (path.parent / target.split("#")[0]).exists(), f"{path.name}: {target}"

