"""What Linux says of a process's threads."""

from pathlib import Path

from slam.processor_time import ProcessorClock


def write(threads: Path, **waited: int) -> None:
    for name, nanoseconds in waited.items():
        (threads / name).mkdir(exist_ok=True)
        (threads / name / "schedstat").write_text(f"123456 {nanoseconds} 17\n")


def test_waiting_is_summed_over_all_threads(tmp_path: Path) -> None:
    write(tmp_path, one=1_000_000, two=500_000)
    clock = ProcessorClock(tmp_path)

    write(tmp_path, one=3_000_000, two=600_000)
    used = clock.stop()

    assert used.waited_us == 2_100
    assert used.cpu_us is not None
    assert used.cpu_us >= 0


def test_a_system_that_does_not_count_says_nothing(tmp_path: Path) -> None:
    assert ProcessorClock(tmp_path / "none").stop().waited_us is None


def test_this_machine_counts_for_this_process() -> None:
    if not Path("/proc/self/schedstat").exists():
        return
    clock = ProcessorClock()
    sum(number * number for number in range(200_000))

    used = clock.stop()

    assert used.waited_us is not None
    assert used.cpu_us
