"""Rules that the whole repository keeps: the direction of imports, and what may not be committed."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.single_looks import offences

ROOT = Path(__file__).parent.parent
# Where the rules of language hold.
PLAIN = ("frontrunner", "slam", "pareto", "client_kit", "crowd", "wire", "groundwork", "tests")
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
# The helper that waits sleeps, and benchmarks measure time.
MAY_WAIT = (
    "tests/waiting.py",
    "tests/benchmarks/",
    # Programs that play others: a slow measurement, systemd, a crowd of workers.
    "tests/services/table.py",
    "tests/services/units.py",
    "tests/services/racing.py",
)
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
    ("text", "banned"),
    [
        ("A length that is none.", True),
        ("Whoever reads this", True),
        ("This is no list", True),
        ("It is told so", True),
        ("The own data", True),
        ("if value is None:", False),
        ("there is no file", False),
        ("is no longer here", False),
        ("is not a list", False),
    ],
)
def test_home_made_english_is_recognised(text, banned):
    assert bool(BANNED.search(text)) is banned


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


@pytest.mark.slow
def test_nothing_looks_once_and_nothing_sleeps():
    """What another thread, process, browser or task does a moment later is waited for by `until`."""
    found = {
        f"{name}:{line}": offence
        for path in plain_files({".py"})
        if (name := path.relative_to(ROOT).as_posix()).startswith("tests/")
        if not name.startswith(MAY_WAIT)
        for line, offence in offences(path.read_text(encoding="utf-8"))
    }
    assert found == {}


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        # Sleeping.
        ("time.sleep(1)", [1]),
        ("from time import sleep\nsleep(0.1)", [2]),
        ("async def one():\n    await asyncio.sleep(1)", [2]),
        ("page.wait_for_timeout(500)", [1]),
        ('program = "import time; time.sleep(600)"', []),
        ('monkeypatch.setattr(time, "sleep", slept.append)', []),
        ("until(lambda: done())", []),
        # Waiting loops.
        ("while time.monotonic() < limit:\n    look()", [1]),
        ("while not done():\n    if time.time() > limit:\n        break", [1]),
        ("while waiting:\n    waiting.pop()", []),
        ("limit = time.monotonic() + 5", []),
        # Assertions about time that passed.
        ("begun = time.monotonic()\nwork()\nassert time.monotonic() - begun < 5", [3]),
        ("begun = perf_counter()\nwork()\ntook = perf_counter() - begun\nassert took < 5", [4]),
        ("def test():\n    a, b = clock(), time.time()\n    assert 1 < end - b < 2", [3]),
        ("begun = time.process_time()\nspent = time.process_time() - begun\nprint(spent)", []),
        ("before = time.time()\nassert before <= stored.made_at", []),
        ("def one():\n    took = time.time() - 1\ndef other():\n    assert took < 5", []),
        ("assert row.time() - 1 < 5", []),
        # A look directly after an action on a page.
        ('page.click("a")\nassert page.locator("b").is_visible()', [2]),
        ('field.fill("x")\nassert ready\nassert "x" in field.inner_text()', [3]),
        ('with one():\n    field.press("Tab")\n    assert rows.count() == 1', [3]),
        ("box.check()\nexpect(row).to_be_visible()\nassert rows.count() == 1", []),
        ("box.check()\nassert until(lambda: rows.count() == 1)", []),
        ('page.goto("/")\nassert rows.count() == 1', []),
        ('form.check(one)\nassert words.count("a") == 1', []),
        ("command.check()\nassert Run.objects.count() == 1", []),
    ],
)
def test_what_waits_by_itself_is_recognised(source, lines):
    assert [line for line, _ in offences(source)] == lines


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
