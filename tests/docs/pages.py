"""The text of the documents: prose without code, and the commands that they show."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FENCE = re.compile(r"^```.*?^```[^\S\n]*$", re.MULTILINE | re.DOTALL)


def manual() -> list[Path]:
    """Every page that tells how to use something, and the README."""
    elsewhere = {DOCS / "research", DOCS / "decisions"}
    pages = [page for page in sorted(DOCS.rglob("*.md")) if not elsewhere & set(page.parents)]
    return [*pages, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]


def research() -> list[Path]:
    return sorted([*(DOCS / "research").rglob("*.md"), *(DOCS / "decisions").rglob("*.md")])


def prose(text: str) -> str:
    """`text` without code, addresses and comments."""
    text = FENCE.sub("", text)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"`+[^`]+`+", "CODE", text)
    return re.sub(r"\]\([^)]*\)", "]", text)


def sentences(text: str) -> list[str]:
    """The sentences of paragraphs, list items and table cells."""
    found = []
    for block in re.split(r"\n\s*\n|^#.*$|^\s*(?:[-*]|\d+\.)\s|\|", prose(text), flags=re.MULTILINE):
        joined = " ".join(block.split())
        found += re.split(r"(?<=[.!?:;])[\"*)_]*\s+(?=[\"*(_\[A-Z0-9])", joined)
    return [sentence for sentence in found if sentence]


def words(text: str) -> int:
    return len(re.findall(r"[A-Za-z0-9][\w'.,-]*", prose(text)))


def code(text: str) -> str:
    """The shell commands of `text`: blocks of a shell, lines joined where they continue, and inline code."""
    blocks = re.findall(r"^```(?:sh|console|bash)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    inline = re.findall(r"`([^`\n]+)`", FENCE.sub("", text))
    return "\n".join([*(block.replace("\\\n", " ") for block in blocks), *inline])
