"""The shell commands of the page about deployment are executed, in a throw-away copy of this machine's root.

systemctl and journalctl are replaced: tests/services/units.py carries out what the units say. Nothing is
downloaded: apt-get only uncovers this machine's git and make, and the packages of Python are the tests'.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.services.program import ROOT, free_port

PAGE, UNITS = ROOT / "docs" / "operate" / "deploy.md", Path(__file__).with_name("units.py")
HOST, PYTHON = "deployed.example", Path(sys.prefix) / "bin" / "python"
# An overlay of the root, which ends with the namespace.
ENTER = """
set -eu
mount -t overlay overlay -o lowerdir=/,upperdir={folder}/upper,workdir={folder}/work {folder}/root
mount --rbind /dev {folder}/root/dev
mount -t proc proc {folder}/root/proc
"""
# The server's user reaches the tests' Python, of which each clone gets the environment.
PREPARE = """
set -eu
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin GIT_TEMPLATE_DIR={folder}/template
export GIT_PROGRESS_DELAY=1000
chmod a+x {parents}
for program in systemctl journalctl; do
    printf '#!/bin/sh\\nexec {python} {units} "$0" "$@"\\n' >/usr/local/bin/$program
    chmod 755 /usr/local/bin/$program
done
mkdir /packages
for program in git make; do mv $(command -v $program) /packages/; done
printf '#!/bin/sh\\nfor name; do mv /packages/$name /usr/bin; done; true\\n' >/usr/local/bin/apt-get
chmod 755 /usr/local/bin/apt-get
"""
START = "systemctl daemon-reload"
PORT = "sed -i 's/^FRONTRUNNER_PORT=.*/FRONTRUNNER_PORT={port}/' /etc/frontrunner.env"
WAIT = """
{python} - <<'END' || { journalctl -u frontrunner; exit 1; }
import sys, time, urllib.request
for attempt in range(4800):
    try:
        urllib.request.urlopen("http://127.0.0.1:{port}/healthz")
        break
    except OSError:
        time.sleep(0.25)
else:
    sys.exit("the server does not answer")
END
"""
LOOK = """
journalctl -u frontrunner
frontrunner admin check_public || true
frontrunner admin totp admin
frontrunner admin shell --no-imports -c '
from crowd.explorations.measuring.software import software_version
print("version", software_version())'
ls -l /var/backups/frontrunner
systemctl stop frontrunner
"""


def blocks(section: str) -> str:
    """The shell blocks of that section of the page."""
    (text,) = re.findall(rf"^## {section}\n(.*?)(?=^## )", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    return "\n".join(re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder for an overlay of the root, with this checkout as a repository."""
    root = Path("/").stat().st_dev
    if apart := [path for path in (tmp_path, ROOT, PYTHON) if path.stat().st_dev != root]:
        pytest.skip(f"an overlay of the root lacks {apart[0]}, which is on another file system")
    for name in ("upper", "work", "root", "template/hooks"):
        (tmp_path / name).mkdir(parents=True)
    hook = tmp_path / "template" / "hooks" / "post-checkout"
    hook.write_text(f"#!/bin/sh\nln -sfn {sys.prefix} .venv\n")
    hook.chmod(0o755)
    git = ["git", f"--git-dir={tmp_path}/source.git", f"--work-tree={ROOT}"]
    git += ["-c", "user.name=Test", "-c", "user.email=test@deployed.example"]
    for arguments in (["init", "--quiet"], ["add", "--all"], ["commit", "--quiet", "--message", "Tested"]):
        subprocess.run([*git, *arguments], cwd=ROOT, check=True)
    return tmp_path


def execute(folder: Path, script: str) -> str:
    """What `script` prints in the overlay, together with its errors. It must succeed."""
    enter = ENTER.format(folder=folder)
    unshare = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c"]
    entered = subprocess.run([*unshare, enter], capture_output=True, text=True, check=False)
    if entered.returncode:
        pytest.skip(f"no overlay of the root can be mounted here: {entered.stderr.strip()}")
    (folder / "script.sh").write_text(script)
    # Without this environment: `make test-slow` exports settings, which an operator's shell does not have.
    chroot = f"{enter}exec chroot {folder}/root env -i HOME=/root sh {folder}/script.sh"
    done = subprocess.run(
        [*unshare, chroot], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-5000:]
    return done.stdout


def test_the_page_s_commands_deploy_upgrade_back_up_and_restore(folder: Path) -> None:
    parents = {str(parent) for prefix in (sys.prefix, sys.base_prefix) for parent in Path(prefix).parents}
    names = {
        "folder": folder,
        "parents": " ".join(sorted(parents)),
        "port": free_port(),
        "python": PYTHON,
        "units": UNITS,
    }
    install = blocks("One machine")
    for word, replacement in (
        ("ADDRESS", f"{folder}/source.git"),
        ("YOUR.NAME", HOST),
        (START, f"{PORT}\n{START}"),
    ):
        assert install.count(word) == 1
        install = install.replace(word, replacement)
    parts = [PREPARE, install, WAIT, blocks("Upgrade"), WAIT, blocks("Back up and restore"), WAIT, LOOK]
    script = "\n".join(parts)
    for name, value in names.items():
        script = script.replace(f"{{{name}}}", str(value))

    output = execute(folder, script)

    assert re.search(r"Administrator at http\S+/admin/: user admin, password \S+", output)
    assert re.search(r"Restored the state of", output)
    assert re.search(rf"passed +Host names: reached as {HOST}", output)
    assert re.search(r"passed +Backup: made", output)
    assert "otpauth://totp/" in output
    assert re.search(r"version \d[\w.]*\+[0-9a-f]{12}", output)
    assert re.search(r"-rw------- 1 frontrunner frontrunner .* frontrunner-\d{8}T\d{6}\.tar\.gz", output)
    assert "Traceback" not in output
