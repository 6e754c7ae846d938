"""What the comparison says: tables, and which of the project's targets are met."""

from __future__ import annotations

from typing import Any

import numpy as np

from pareto.search.methods import METHODS

# By problem: at most `share` of the best other's mean regret, and at most `most`, at each mark.
TARGETS: dict[str, tuple[float, dict[int, float]]] = {
    "kfusion, limits": (0.5, {}),
    "kfusion, no limits": (0.5, {}),
    "kfusion, limits, smooth": (0.5, {}),
    "kfusion, limits, smooth, 2 % noise": (1.0, {}),
    "kfusion, no limits, smooth": (0.5, {}),
    "BlackScholes": (1.0, {200: 0.02}),
    "BlackScholes, 5 % noise": (1.0, {}),
    "convolution, no constraints": (1.0, {}),
    "convolution, constraints": (1.0, {}),
    "kernel": (1.0, {}),
}
CPU_MS = 100.0  # a suggestion, at most
ENOUGH = 5  # seeds behind each of two means, before one is said to be better


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
            if "discovered" in row:
                found = "".join(
                    f"{cell(row['discovered'][reference].get(mark)):>18}" for mark in result["marks"]
                )
                print(f"{'  discovered':<16}{found}")


def cell(regrets: list[float] | None) -> str:
    """Mean and standard deviation, or nothing where a method was not run that far."""
    if regrets is None:
        return ""
    return f"{np.mean(regrets):.4f} ±{np.std(regrets, ddof=min(1, len(regrets) - 1)):.4f}"


def best_peer(
    result: dict[str, Any], reference: str, mark: int, least: int = 1
) -> tuple[str, int, float] | None:
    """Name, seeds and mean regret of the best other optimiser with `least` seeds; `pareto`'s own are none."""
    means = [
        (row["name"], len(row["seeds"]), float(np.mean(row["regret"][reference][mark])))
        for row in result["rows"]
        if row["name"] not in METHODS
        and "failed" not in row
        and len(row["seeds"]) >= least
        and mark in row["regret"][reference]
    ]
    return min(means, key=lambda found: found[2], default=None)


def verdict(result: dict[str, Any], reference: str, mark: int, ours: str) -> str:
    """Whether the target is "met", "short", or "open" with what is missing before that can be said.

    It is met only against the best of the other optimisers, ENOUGH seeds behind it and behind `ours`.
    """
    share, ceilings = TARGETS[result["problem"]]
    row = next(row for row in result["rows"] if row["name"] == ours)
    mean = float(np.mean(row["regret"][reference][mark]))
    if len(row["seeds"]) < ENOUGH:
        return f"open: {ours} has {len(row['seeds'])} of {ENOUGH} seeds"
    known = best_peer(result, reference, mark, ENOUGH)
    if mean > ceilings.get(mark, 1.0) or (known and mean > share * known[2]):
        return "short"
    best = best_peer(result, reference, mark)
    if best is None:
        return "open: no other optimiser was run"
    name, seeds, regret = best
    if seeds >= ENOUGH:
        return "met"
    would = "met" if mean <= share * regret else "short"
    return f"open: {name} has {seeds} of {ENOUGH} seeds ({would} so far)"


def print_targets(results: list[dict[str, Any]], timed: dict[str, Any], ours: str) -> None:
    """A line for each target: the figure, the aim, and whether it is met."""
    print(f"\n{'target':<44}{'ours':>9}{'best other (seeds)':>30}{'ratio':>8}{'aim':>8}")
    said: list[str] = []
    for result in results:
        share, ceilings = TARGETS[result["problem"]]
        row = next(row for row in result["rows"] if row["name"] == ours)
        for reference in result["references"]:
            for mark, regrets in row["regret"][reference].items():
                mean, other = float(np.mean(regrets)), best_peer(result, reference, mark)
                name, regret = (f"{other[0]} ({other[1]})", other[2]) if other else ("", float("nan"))
                label = f"{result['problem']}, {mark} (from {reference})"
                ratio = mean / regret if regret else float(mean > 0)
                aim = f"{share:g}" + (f", {ceilings[mark]:g}" if mark in ceilings else "")
                said.append(verdict(result, reference, mark, ours))
                print(f"{label:<44}{mean:>9.4f}{name:>22}{regret:>8.4f}{ratio:>8.2f}{aim:>9}  {said[-1]}")
        label = f"{result['problem']}, CPU ms a suggestion"
        said.append("met" if row["cpu_ms"] < CPU_MS else "short")
        print(f"{label:<44}{row['cpu_ms']:>9.1f}{'':>38}{CPU_MS:>9g}  {said[-1]}")
    for timing in timed["rows"]:
        if timing.get("aim_seconds") is not None:
            said.append("met" if timing["seconds"] < timing["aim_seconds"] else "short")
            line = f"{timing['what']:<44}{timing['seconds']:>8.3f}s{'':>38}{timing['aim_seconds']:>8g}s"
            print(f"{line}  {said[-1]}")
    print(f"{said.count('met')} of {len(said)} targets met, {said.count('short')} short, the others open")
