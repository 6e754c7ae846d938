"""A demo server's mark moves with its database, and never into another server's."""

from pathlib import Path

from crowd.demo.mark import SENTENCE
from tests.services import intake
from tests.services.serving import commands, each, refusal


def test_a_demo_stays_a_demo_wherever_it_is_restored_and_never_replaces_another_server(
    tmp_path: Path,
) -> None:
    demo, elsewhere, real, file = (tmp_path / name for name in ("demo", "elsewhere", "real", "backup.tar.gz"))
    commands(demo, "prepare --demo --devices 1", f"backup {file}")
    intake.prepare(real, {})

    restored, started = each(elsewhere, f"restore {file}", "prepare")
    refused, marked = each(real, f"restore {file}", "prepare --demo")

    assert restored.returncode == 0, restored.stderr
    assert SENTENCE in restored.stdout
    assert SENTENCE in started.stdout
    assert "is not replaced" in refusal(refused)
    assert "a real server" in refusal(marked)
