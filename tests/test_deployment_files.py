"""The files under deploy/: units that systemd takes, settings that exist, containers that run the same."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from crowd.operations import web_server

ROOT = Path(__file__).resolve().parents[1]
DEPLOY = ROOT / "deploy"
UNITS = sorted(path.name for path in DEPLOY.iterdir() if path.suffix in {".service", ".timer"})


@pytest.fixture
def units(tmp_path: Path) -> Path:
    """A folder of the units as if this checkout were installed; the template with an instance."""
    for name in UNITS:
        text = (DEPLOY / name).read_text().replace("/opt/frontrunner", str(ROOT))
        (tmp_path / name.replace("@.", "@crowd.")).write_text(text)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
@pytest.mark.parametrize("name", UNITS)
def test_systemd_takes_the_unit(units: Path, name: str) -> None:
    unit = units / name.replace("@.", "@crowd.")

    done = subprocess.run(
        ["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False
    )

    assert [line for line in done.stderr.splitlines() if "frontrunner" in line] == []


@pytest.mark.parametrize("name", [name for name in UNITS if name.endswith(".service")])
def test_what_a_unit_writes_is_closed_to_other_users(name: str) -> None:
    assert "\nUMask=0077\n" in (DEPLOY / name).read_text()


def test_every_variable_of_the_example_is_a_setting() -> None:
    named = set(re.findall(r"^#?([A-Z_]+)=", (DEPLOY / "frontrunner.env").read_text(), re.MULTILINE))

    described = set(re.findall(r"^\| ([A-Z_]+) \|", (ROOT / "crowd/settings.py").read_text(), re.MULTILINE))
    assert len(named) > 5
    assert named <= described


def test_the_unit_starts_the_web_server_as_serve_does() -> None:
    unit = (DEPLOY / "frontrunner-web.service").read_text()
    (line,) = re.findall(r"^ExecStart=(.*granian.*)$", unit, re.MULTILINE)
    options = ("--workers", "2", "--workers-kill-timeout", "10")

    _, *expected = web_server.command("${FRONTRUNNER_BIND}", "${FRONTRUNNER_PORT}", *options)
    assert line.split()[1:] == expected


def test_caddy_asks_by_the_name_that_it_serves() -> None:
    caddy = (DEPLOY / "Caddyfile").read_text()
    (site,) = re.findall(r"^(\S+) \{$", caddy, re.MULTILINE)

    assert re.search(rf"health_headers \{{\s+Host {re.escape(site)}\s+\}}", caddy)


def test_the_page_names_only_files_that_are_there() -> None:
    page = (ROOT / "docs/operate/deploy.md").read_text()

    for name in re.findall(r"frontrunner-?[a-z]*@?[a-zA-Z]*\.(?:service|timer)", page):
        assert re.sub(r"@[a-zA-Z]+", "@", name) in UNITS
    for link in re.findall(r"\]\(([^)#:]+)\)", page):
        assert (ROOT / "docs/operate" / link).exists(), link


def test_containers_run_what_the_units_run_as_another_user_than_root() -> None:
    services = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]
    unit = (DEPLOY / "frontrunner-web.service").read_text()
    (line,) = re.findall(r"^ExecStart=\S+ -m (granian.*)$", unit, re.MULTILINE)

    line = line.replace("${FRONTRUNNER_BIND}", "127.0.0.1").replace("${FRONTRUNNER_PORT}", "8000")
    assert services["web"]["command"] == line.split()
    for name in ("worker", "beat"):
        (unit_name,) = (each for each in UNITS if each.startswith(f"frontrunner-{name}"))
        (line,) = re.findall(r"^ExecStart=\S+ -m (celery.*)$", (DEPLOY / unit_name).read_text(), re.MULTILINE)
        expected = line.replace("--hostname %i@%H ", "").replace("%i", "crowd")
        assert services[name]["command"] == expected.split()
    assert re.search(r"^USER [1-9]\d*$", (DEPLOY / "Dockerfile").read_text(), re.MULTILINE)


@pytest.mark.skipif(shutil.which("hadolint") is None, reason="no hadolint here")
def test_hadolint_finds_nothing_in_the_dockerfile() -> None:
    done = subprocess.run(
        ["hadolint", str(DEPLOY / "Dockerfile")], capture_output=True, text=True, check=False
    )

    assert (done.returncode, done.stdout) == (0, "")
