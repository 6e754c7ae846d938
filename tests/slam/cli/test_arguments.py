import io
import sys

import pytest

from slam.cli.arguments import UsageError, progress_line, values, writable


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_sees_one_line_that_counts_up(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    show = progress_line("mu=0.1: ")
    for done in (1, 2, 3):
        show(done, 3)
    text = sys.stderr.getvalue()
    assert text.count("\n") == 1
    assert [part.split(",")[0] for part in text.split("\r")[1:]] == [
        "mu=0.1: frame 1/3",
        "mu=0.1: frame 2/3",
        "mu=0.1: frame 3/3",
    ]
    assert text.endswith("0 s left\x1b[K\n")


def test_a_pipe_sees_no_progress(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert progress_line() is None


def test_values_are_sorted_and_different():
    assert values("0.3,1e-5,0.3,2") == (1e-5, 0.3, 2)


def test_what_cannot_be_written_is_said_before_the_work(tmp_path):
    writable(None)
    writable(tmp_path / "new.txt")
    with pytest.raises(UsageError, match="it is a folder"):
        writable(tmp_path)
    with pytest.raises(UsageError, match="there is no folder"):
        writable(tmp_path / "no" / "file")
