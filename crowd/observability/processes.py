"""What the processes that share their metrics need of this machine. Linux alone tells it."""

import os
from collections.abc import Iterator
from pathlib import Path

from crowd.observability.metrics import gauge, label

PROC, TICKS, PAGE = Path("/proc"), os.sysconf("SC_CLK_TCK"), os.sysconf("SC_PAGE_SIZE")


def gauges(folder: Path) -> Iterator[str]:
    """CPU, memory and open files of each running process with a copy in `folder`."""
    cpu, resident, files = {}, {}, {}
    for copy in folder.glob("*.json"):
        kind, pid, _ = copy.stem.split("-")
        labels = f"{label('kind', kind)},{label('pid', pid)}"
        try:
            user, system = (PROC / pid / "stat").read_text().rpartition(") ")[2].split()[11:13]
            pages = (PROC / pid / "statm").read_text().split()[1]
            files[labels] = len(os.listdir(PROC / pid / "fd"))
        except OSError:  # the process ended
            continue
        cpu[labels] = (int(user) + int(system)) / TICKS
        resident[labels] = int(pages) * PAGE
    yield gauge("process_cpu_seconds", "CPU time of the process", cpu)
    yield gauge("process_resident_bytes", "Memory of the process", resident)
    yield gauge("process_open_files", "Open files of the process", files)
