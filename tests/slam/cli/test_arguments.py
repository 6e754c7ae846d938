import pytest

from slam.cli.arguments import UsageError, values, writable


def test_values_are_sorted_and_different():
    assert values("0.3,1e-5,0.3,2") == (1e-5, 0.3, 2)


def test_what_cannot_be_written_is_said_before_the_work(tmp_path):
    writable(None)
    writable(tmp_path / "new.txt")
    with pytest.raises(UsageError, match="it is a folder"):
        writable(tmp_path)
    with pytest.raises(UsageError, match="there is no folder"):
        writable(tmp_path / "no" / "file")
