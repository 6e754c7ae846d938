"""Documents are written in short sentences of standard English."""

import re
from pathlib import Path

import pytest

from tests.docs import pages

LONGEST = 25
LONGEST_IN_RESEARCH = 45
# Home-made English, with what to write instead.
BANNED = {
    r"\bforetold?\b": "predicted",
    r"\btold\b": "reported",
    r"\bheed": "respect",
    r"\banew\b": "again",
    r"\bseldom\b": "rarely",
    r"\bwho(?:so)?ever\b": "anyone who",
    r"\bwherein\b": "where",
    r"\bat present\b": "now",
    r"\bthe own\b": "your",
    r"(?<!there )\bis no (?!longer|worse|better)": "is not a",
    r"(?<!there )\bare no (?!longer|worse|better)": "are not",
    r"\bis none\b": "is not",
    r"\bdear to\b": "expensive to",
    r"\bgoes on\b": "continues",
    r"\bgo on\b": "continue",
    r"\bits like\b": "similar ones",
}


def too_long(page: Path, limit: int) -> list[str]:
    return [
        f"{page.relative_to(pages.ROOT)}: {len(sentence.split())} words: {sentence}"
        for sentence in pages.sentences(page.read_text(encoding="utf-8"))
        if len(sentence.split()) > limit
    ]


@pytest.mark.parametrize("page", pages.manual(), ids=lambda page: page.stem)
def test_sentences_of_the_manual_are_short(page: Path) -> None:
    assert too_long(page, LONGEST) == []


@pytest.mark.parametrize("page", pages.research(), ids=lambda page: page.stem)
def test_sentences_of_research_are_not_endless(page: Path) -> None:
    assert too_long(page, LONGEST_IN_RESEARCH) == []


@pytest.mark.parametrize("page", [*pages.manual(), *pages.research()], ids=lambda page: page.stem)
def test_documents_have_no_home_made_english(page: Path) -> None:
    text = " ".join(pages.prose(page.read_text(encoding="utf-8")).split())
    found = [
        f"...{text[max(0, match.start() - 30) : match.end() + 20]}... -> {better}"
        for phrase, better in BANNED.items()
        for match in re.finditer(phrase, text, re.IGNORECASE)
    ]
    assert found == []
