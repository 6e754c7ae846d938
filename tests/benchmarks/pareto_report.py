"""What the comparison says: tables, and which of the project's targets are met."""

from __future__ import annotations

from typing import Any

import numpy as np

# By problem: at most `share` of the best other's mean regret, and at most `most`, at each mark.
TARGETS: dict[str, tuple[float, dict[int, float]]] = {
    "kfusion, limits": (0.5, {}),
    "kfusion, no limits": (0.5, {}),
    "kfusion, limits, smooth": (0.5, {}),
    "BlackScholes": (1.0, {200: 0.02}),
    "convolution, no constraints": (1.0, {}),
    "convolution, constraints": (1.0, {}),
    "kernel": (1.0, {}),
}
CPU_MS = 100.0  # a suggestion, at most


def print_table(result: dict[str, Any]) -> None:
    """Mean regret with its standard deviation over seeds at every mark, a row a method."""
    for reference, point in result["references"].items():
        where = ", ".join(f"{value:.4g}" for value in point)
        print(f"\n{result['problem']}: {result['points']:,} points")
        print(f"regret from {reference} ({where})")
        marks = "".join(f"{mark:>18}" for mark in result["marks"])
        print(f"{'evaluations':<16}{marks}{'seeds':>7}{'CPU ms':>9}{'twice':>8}{'refused':>9}")
        for row in result["rows"]:
            if "failed" in row:
                print(f"{row['name']:<16}  not measured: {row['failed']}")
                continue
            cells = "".join(f"{cell(row['regret'][reference].get(mark)):>18}" for mark in result["marks"])
            twice = f"{100 * row['duplicates']:.0f} %"
            counted = f"{len(row['seeds']):>7}{row['cpu_ms']:>9.1f}{twice:>8}{row['refused']:>9.0f}"
            print(f"{row['name']:<16}{cells}{counted}")


def cell(regrets: list[float] | None) -> str:
    """Mean and standard deviation, or nothing where a method was not run that far."""
    if regrets is None:
        return ""
    return f"{np.mean(regrets):.4f} ±{np.std(regrets, ddof=min(1, len(regrets) - 1)):.4f}"


def best_other(result: dict[str, Any], reference: str, mark: int, ours: str) -> tuple[str, float] | None:
    """The least mean regret of all but `ours`: other optimisers, random search and the paper's loop.

    The name says how many seeds it is the mean of.
    """
    means = [
        (f"{row['name']} ({len(row['seeds'])})", float(np.mean(row["regret"][reference][mark])))
        for row in result["rows"]
        if row["name"] != ours and "failed" not in row and mark in row["regret"][reference]
    ]
    return min(means, key=lambda pair: pair[1], default=None)


def print_targets(results: list[dict[str, Any]], timed: dict[str, Any], ours: str) -> None:
    """A line for each target: the figure, the aim, and whether it is met."""
    print(f"\n{'target':<44}{'ours':>9}{'best other (seeds)':>30}{'ratio':>8}{'aim':>8}")
    met = total = 0
    for result in results:
        share, ceilings = TARGETS[result["problem"]]
        row = next(row for row in result["rows"] if row["name"] == ours)
        for reference in result["references"]:
            for mark, regrets in row["regret"][reference].items():
                mean, other = float(np.mean(regrets)), best_other(result, reference, mark, ours)
                name, regret = other or ("", float("nan"))
                reached = mean <= share * regret and mean <= ceilings.get(mark, 1.0)
                met, total = met + reached, total + 1
                label = f"{result['problem']}, {mark} (from {reference})"
                ratio = mean / regret if regret else float(mean > 0)
                aim = f"{share:g}" + (f", {ceilings[mark]:g}" if mark in ceilings else "")
                verdict = "met" if reached else "short"
                print(f"{label:<44}{mean:>9.4f}{name:>22}{regret:>8.4f}{ratio:>8.2f}{aim:>9}  {verdict}")
        label = f"{result['problem']}, CPU ms a suggestion"
        reached = row["cpu_ms"] < CPU_MS
        met, total = met + reached, total + 1
        print(f"{label:<44}{row['cpu_ms']:>9.1f}{'':>38}{CPU_MS:>9g}  {'met' if reached else 'short'}")
    for timing in timed["rows"]:
        if timing.get("aim_seconds") is not None:
            reached = timing["seconds"] < timing["aim_seconds"]
            met, total = met + reached, total + 1
            line = f"{timing['what']:<44}{timing['seconds']:>8.3f}s{'':>38}{timing['aim_seconds']:>8g}s"
            print(f"{line}  {'met' if reached else 'short'}")
    print(f"{met} of {total} targets met")
