"""Crowds through the API: participants that each sent something. All figures are made up for testing."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tests.builders.documents import DEFAULT_SECONDS, device_document, session_document, submission_document
from tests.builders.participant import Participant

# Enrols one more participant, from its own network unless it names one: the fixture `join`.
Join = Callable[..., Participant]


def send(
    who: Participant, *sessions: dict[str, Any], device: str | dict[str, Any] = "Pixel 8", **changes: Any
) -> Any:
    """The answer to a submission of `sessions` (one ordinary one unless given), which the server takes.

    `device` is a whole document or the name of a phone's model; `changes` are those of the submission.
    """
    described = device_document(device) if isinstance(device, str) else device
    answer = who.submit(submission_document(*sessions, device=described, **changes))
    assert answer.status_code == 202, answer.content
    return answer


def session_of(speedup: float = 8.0, **changes: Any) -> dict[str, Any]:
    """A session in which best is `speedup` times as fast as the default."""
    return session_document(best_us=round(1e6 * DEFAULT_SECONDS / speedup), **changes)


def crowd(
    join: Join, speedups: Mapping[str, float | Sequence[float]], network: str = "", **device: Any
) -> list[Participant]:
    """One participant for each speedup of each model, in that order. Each sent one session.

    Each is from its own network unless all are from `network`. `device` changes their strings.
    """
    members = []
    for model, figures in speedups.items():
        for speedup in figures if isinstance(figures, Sequence) else [figures]:
            members.append(join(network) if network else join())
            send(members[-1], session_of(speedup), device=device_document(model, **device))
    return members
