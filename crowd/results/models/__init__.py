"""Measurements as they were sent, and the summaries and figures that tasks derive from them.

Submission, MeasurementSession, Run and RunFrames are raw data. Cohort, SessionSummary, DeviceSpeedup and
DeviceActivity are derived from them and from the Decisions of administrators.
"""

from crowd.results.models.derived import Cohort, DeviceActivity, DeviceSpeedup, Outcome, SessionSummary
from crowd.results.models.exports import Export, ExportFile, FileChange, StoredFile
from crowd.results.models.measured import (
    Decision,
    MeasurementSession,
    Run,
    RunFrames,
    State,
    Submission,
)
from crowd.results.models.records import RowCount, Tombstone, WorkerPulse

__all__ = [
    "Cohort",
    "Decision",
    "DeviceActivity",
    "DeviceSpeedup",
    "Export",
    "ExportFile",
    "FileChange",
    "MeasurementSession",
    "Outcome",
    "RowCount",
    "Run",
    "RunFrames",
    "SessionSummary",
    "State",
    "StoredFile",
    "Submission",
    "Tombstone",
    "WorkerPulse",
]
