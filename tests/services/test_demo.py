"""A demo server's mark moves with its database, and never into another server's."""

from pathlib import Path

from crowd.demo.mark import SENTENCE
from tests.services import intake
from tests.services.serving import command


def test_a_demo_stays_a_demo_wherever_it_is_restored_and_never_replaces_another_server(
    tmp_path: Path,
) -> None:
    demo, elsewhere, real, file = (tmp_path / name for name in ("demo", "elsewhere", "real", "backup.tar.gz"))
    made = command(demo, "prepare", "--demo", "--devices", "1")
    assert made.returncode == 0, made.stderr
    assert command(demo, "backup", str(file)).returncode == 0
    intake.prepare(real, {})

    restored = command(elsewhere, "restore", str(file))
    started = command(elsewhere, "prepare")
    refused = command(real, "restore", str(file))
    marked = command(real, "prepare", "--demo")

    assert restored.returncode == 0, restored.stderr
    assert SENTENCE in restored.stdout
    assert SENTENCE in started.stdout
    assert (refused.returncode, marked.returncode) == (1, 1)
    assert "is not replaced" in refused.stderr
    assert "a real server" in marked.stderr
