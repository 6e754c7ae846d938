"""Rules that the whole repository keeps: the direction of imports, and what may not be committed."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# Where the rules of language hold.
PLAIN = ("frontrunner", "slam", "pareto", "client_kit", "crowd", "tests")
SOURCES = {".py", ".html", ".js", ".cl", ".h", ".wgsl"}
# Home-made English, with the plain word in its place.
PHRASES = {
    r"(?<!there )(?:is|are|was|were) no(?! more| longer| later)": "is not a",
    r"(?:is|are|was|were|be|been|being) told": "reported",
    r"foretold|foretells?": "predicted, predict",
    r"heeds?|heeded": "respect",
    r"anew": "again",
    r"seldom": "rarely",
    r"who(?:so|m)?ever": "anyone who",
    r"wherein": "where",
    r"at present": "now",
    r"the own": "your, its",
    r"nobody": "the subject of the sentence",
    r"that (?:is|are) none": "that is not valid",
    r"one's own": "your own",
    r"but for": "except",
    r"none of it": "nothing",
    r"unsaid": "unreported",
    r"became of|(?:what|that) came of": "the outcome of",
    r"makes? of it": "the result",
}
BANNED = re.compile("|".join(rf"\b(?:{phrase})\b" for phrase in PHRASES), re.IGNORECASE)
ENDINGS = re.compile(r"(?:ations?|ings?|[eo]rs?|ies|ed|es|[sye])$")


def tracked_files() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout: there is no list of tracked files to look through")
    return [ROOT / name for name in listed.stdout.decode().split("\0") if name and (ROOT / name).is_file()]


def plain_files(suffixes: set[str]) -> list[Path]:
    """The tracked files of PLAIN, without migrations, which stay as they were released."""
    folders = {ROOT / name for name in PLAIN}
    return [
        path
        for path in tracked_files()
        if path.suffix in suffixes and folders.intersection(path.parents) and path.parent.name != "migrations"
    ]


def stem(name: str) -> str:
    """`name` without the endings by which words of one root differ: lease, leases, leasing."""
    while (ending := ENDINGS.search(name)) and ending.start() >= 4:
        name = name[: ending.start()]
    return name


@pytest.mark.slow
def test_no_home_made_english():
    """The cure is a sentence with the subject first; see PHRASES for the plain words."""
    offences = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in plain_files(SOURCES)
        if path != Path(__file__)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        # A changed help text would need a migration.
        if BANNED.search(line) and "help_text=" not in line
    ]
    assert not offences, "\n".join(offences)


@pytest.mark.parametrize(
    "text",
    ["A length that is none.", "Whoever reads this", "This is no list", "It is told so", "The own data"],
)
def test_home_made_english_is_recognised(text):
    assert BANNED.search(text)


@pytest.mark.parametrize(
    "text", ["if value is None:", "there is no file", "is no longer here", "is not a list"]
)
def test_plain_english_is_not_banned(text):
    assert not BANNED.search(text)


def test_no_two_modules_of_a_folder_have_one_meaning():
    # The modules of commands are excepted: they have the names of the commands.
    modules = [
        path
        for path in plain_files({".py"})
        if "tests" not in path.relative_to(ROOT).parts and path.parent.name != "commands"
    ]
    roots: dict[tuple[Path, str], list[str]] = {}
    for path in modules:
        roots.setdefault((path.parent, stem(path.stem)), []).append(path.name)
    assert [names for names in roots.values() if len(names) > 1] == []


def test_the_stem_of_a_module_ignores_endings():
    assert len({stem(name) for name in ("lease", "leases", "leasing", "leaser")}) == 1
    assert stem("space") != stem("scene")


def test_imports_run_one_way():
    command = [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("requirements.lock", 30),
        ("requirements-monitoring.lock", 30),
        ("requirements-s3.lock", 30),
        ("requirements-development.lock", 30),
        ("requirements-kernels.lock", 1),
    ],
)
def test_locks_have_hashes_and_no_addresses(name, least):
    text = (ROOT / name).read_text()
    assert "://" not in text
    pinned = re.findall(r"^[a-z0-9][\w.\[\]-]*==\S+.*(?:\n    .*)*", text, re.MULTILINE)
    assert len(pinned) >= least
    assert all("--hash=sha256:" in requirement for requirement in pinned)


def test_no_tracked_file_is_large():
    """A pack of the sequence is split into chunks; nothing else is big."""
    large = [path for path in tracked_files() if path.stat().st_size > 8 * 2**20]
    assert large == []


@pytest.mark.parametrize(
    ("package", "module"), [("pyopencl", "opencl"), ("wgpu", "webgpu"), ("wasmtime", "wasm")]
)
def test_one_module_drives_the_devices_of_a_backend(package, module):
    """Neither may be imported before it is needed: OpenCL hangs in a forked child."""
    modules = {
        str(path.relative_to(ROOT))
        for path in tracked_files()
        if path.suffix == ".py"
        and re.search(rf"^\s*(import|from) {package}\b", path.read_text(), re.MULTILINE)
    }

    assert modules == {f"slam/devices/{module}.py"}


def test_tags_of_templates_end_on_their_line_and_hold_no_other():
    """Django shows a tag that is broken over two lines, and one inside another, as text."""
    broken = re.compile(r"\{\{(?!.*\}\})|\{%(?!.*%\})|\{%[^%]*\{\{[^%]*%\}")
    offences = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in tracked_files()
        if path.suffix == ".html" and "crowd" in path.relative_to(ROOT).parts
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if broken.search(line)
    ]
    assert not offences, "\n".join(offences)
