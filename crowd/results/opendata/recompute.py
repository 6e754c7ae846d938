"""Recompute every figure of this export from its summaries and sessions, and compare. Needs pandas and scipy.

    python recompute.py FOLDER      # of the export's files

The guide's page "What the figures mean" explains each step.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import t

FIGURE = ["front", "configuration", "baseline", "device", "backend", "processor", "processor_class"]
folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")


def read(table: str) -> pd.DataFrame:
    """A table with all of its parts, in the order of storage."""
    parts = sorted(folder.glob(f"{table}*.parquet"), key=lambda path: (len(path.name), path.name))
    return pd.concat(map(pd.read_parquet, parts), ignore_index=True)


def robust_mean(logs: np.ndarray) -> float:
    """Huber's mean: a unit beyond `limit` counts as if it were there."""
    centre = np.median(logs) if len(logs) > 2 else np.mean(logs)
    deviation = 1.4826 * np.median(abs(logs - centre))
    limit = 1.345 * np.clip(deviation, 0.01, np.log(1.15) / 1.345)
    for _ in range(30 if len(logs) > 2 else 0):
        weights = np.minimum(1, limit / np.maximum(abs(logs - centre), 1e-12))
        before, centre = centre, (weights * logs).sum() / weights.sum()
        if abs(centre - before) < 1e-9:
            break
    return float(centre)


def figure(sessions: pd.DataFrame) -> pd.Series:
    """The figure that these sessions make."""
    sessions = sessions[sessions.state == ("valid" if "valid" in sessions.state.array else "suspect")]
    by_installation = sessions.groupby("installation")
    unit = by_installation.network_group.first().astype("string")
    units = by_installation.log_ratio.mean().groupby(unit.fillna(unit.index.to_series())).mean().to_numpy()
    n, log, only = len(units), robust_mean(units), len(sessions) == 1
    low, high = sessions[["low", "high"]].iloc[0] if only else (np.nan, np.nan)
    spread = units.var(ddof=1) if n > 1 else 0.0
    if n > 2:
        error = max(np.sqrt(spread), 0.01) / np.sqrt(0.9 * n)
    else:
        error = np.sqrt(((n - 1) * spread + 2 * np.log(1.1) ** 2) / (n + 1) / n)
        error = np.fmax(error, np.log(high / low) / (2 * 3.182))
    half = t.ppf(0.975, n - 1) * error if n > 2 else np.nan
    k = len(sessions) if len(by_installation) == 1 and len(sessions) > 2 else 0
    again = t.ppf(0.975, k - 1) * sessions.log_ratio.std() / np.sqrt(k) if k else np.nan
    numbers = {"log_ratio": log, "standard_error": error, "speedup": np.exp(log)}
    numbers |= {
        "low": np.exp(log - half),
        "high": np.exp(log + half),
        "session_low": low,
        "session_high": high,
    }
    numbers |= {"repeat_low": np.exp(log - again), "repeat_high": np.exp(log + again)}
    counts = {"sessions": len(sessions), "installations": len(by_installation)}
    return pd.Series(numbers | counts | {"ate_max": sessions.ate_max.max()})


columns = ["session", "installation", "network_group", "received_at", *FIGURE[3:]]
rows = read("summaries").merge(read("sessions")[columns], on="session")
rows = rows[rows.state.isin(["valid", "suspect"]) & rows.log_ratio.notna()]
day = [*FIGURE, "installation", rows.received_at.dt.date, "state"]
rows = rows[rows.groupby(day).cumcount() < 5]
published = read("figures").set_index(FIGURE).sort_index()
computed = rows.groupby(FIGURE)[rows.columns].apply(figure).sort_index()
pd.testing.assert_frame_equal(
    published[computed.columns].astype(float), computed.astype(float), check_exact=False, rtol=1e-9
)
print(f"{len(computed)} figures, all as published")
