"""The options of `python -m client_kit`, by command."""

import argparse
import os
from pathlib import Path
from typing import Any

from client_kit.delivery.manifest import ALL
from client_kit.device.preflight import IGNORABLE
from client_kit.measuring.worker_client import COMPILING_MINUTES
from groundwork.command_line import Parser
from slam.devices.device import BACKENDS
from wire.protocol import VALID_BELOW

INTERRUPTED = 130
TOKEN_VARIABLE = "FRONTRUNNER_DEVICE_TOKEN"


def parser(prog: str = "python -m client_kit") -> Parser:
    """The parser. Its result has the name of the `command`, and `when_stopped`, the text after Ctrl-C."""
    whole = Parser.of_program(
        prog,
        "Measure how fast dense SLAM runs on this device, by the published Pareto front.",
        "Exit codes: 0 sent or safely stored, 1 a payload does not conform (check), 2 usage, 3 cannot "
        f"measure here, 4 too old, {INTERRUPTED} ended by Ctrl-C.",
    )
    whole.set_defaults(when_stopped="stopped")
    commands = whole.add_subparsers(dest="command", required=True, metavar="COMMAND")
    address: dict[str, Any] = {"metavar": "URL", "help": "address of the Frontrunner server"}
    named: dict[str, Any] = {"metavar": "TEXT", "help": "the device whose name contains this"}
    backend: dict[str, Any] = {
        "choices": BACKENDS,
        "help": "the interface to the device (default: the fastest that works here)",
    }

    run = commands.add_parser("run", help="measure a session and send it")
    run.add_argument("--server", required=True, **address)
    run.add_argument("--application", help="what to measure (as the server asks)", metavar="NAME")
    run.add_argument("--yes", action="store_true", help="agree to the consent text without being asked")
    run.add_argument("--sessions", type=_positive, default=1, metavar="N", help="sessions to measure (1)")
    run.add_argument(
        "--configurations",
        type=_names,
        default=(),
        metavar="NAMES",
        help=f"names of the front, separated by commas; {ALL} is the whole front (as the server asks)",
    )
    run.add_argument("--device", **named)
    run.add_argument("--backend", **backend)
    run.add_argument(
        "--ignore",
        type=_ignored,
        default=(),
        metavar="NAMES",
        help=f"measure in spite of these: {', '.join(IGNORABLE)}",
    )
    run.add_argument("--ignore-battery", action="store_true", help="as --ignore battery")
    run.add_argument(
        "--compiling-minutes",
        type=_positive,
        default=COMPILING_MINUTES,
        metavar="N",
        help=f"give up when the device's compiler does not answer for so long ({COMPILING_MINUTES})",
    )
    shown = run.add_mutually_exclusive_group()
    shown.add_argument(
        "--show-model",
        action="store_true",
        default=None,
        help="show this device's model in public even if few people measured it",
    )
    shown.add_argument("--hide-model", dest="show_model", action="store_false", help="no longer show it")
    further = run.add_mutually_exclusive_group()
    further.add_argument(
        "--probes",
        action="store_true",
        default=None,
        help="also measure what the server assigns to this device (up to two minutes), without asking",
    )
    further.add_argument(
        "--no-probes", dest="probes", action="store_false", help="do not ask for such measurements"
    )
    kept = "stopped; finished runs and sessions are stored and sent by the next `send`"
    run.set_defaults(when_stopped=kept)

    commands.add_parser("doctor", help="whether this device can measure, and what it would send")

    commands.add_parser("status", help="the sessions of this device and their state")

    send = commands.add_parser("send", help="send what is still on this device")
    send.add_argument("--wait", action="store_true", help="go on, with pauses, until all is sent")
    send.set_defaults(when_stopped=kept)

    export = commands.add_parser("export", help="everything kept here and on the servers, as JSON")
    export.add_argument("--out", type=Path, metavar="FILE", help="write to a file instead of standard output")

    erase = commands.add_parser("erase", help="erase what was sent and what is kept here")
    erase.add_argument(
        "--run", metavar="ID", help="only this run, by its id in `export` or its page's address"
    )
    erase.add_argument("--yes", action="store_true", help="erase without being asked")

    commands.add_parser("renew-token", help="replace this client's tokens on the servers")

    choose = commands.add_parser("choose", help="the configuration to run on this device")
    choose.add_argument(
        "--max-ate", type=_positive_number, default=VALID_BELOW, metavar="M", help="metres (0.05)"
    )
    choose.add_argument("--max-ms", type=_positive_number, metavar="T", help="milliseconds a frame")
    choose.add_argument("--server", metavar="URL", help="whose front, when several were visited")
    choose.add_argument("--application", help="of which, when several were measured", metavar="NAME")
    choose.add_argument("--device", **named)
    choose.add_argument("--json", action="store_true", help="print JSON")
    choose.add_argument("--run", type=Path, metavar="SEQUENCE", help="run it over this sequence")
    choose.add_argument("--frames", type=_positive, metavar="N", help="of that sequence (all)")

    evaluate = commands.add_parser(
        "evaluate", help="serve as a reference device: measure the evaluations of the server's explorations"
    )
    evaluate.add_argument("--server", required=True, **address)
    evaluate.add_argument("--device", required=True, metavar="NAME", help="the reference device's name there")
    evaluate.add_argument(
        "--token",
        default=os.environ.get(TOKEN_VARIABLE),
        metavar="T",
        help=f"its token from an administrator (default: {TOKEN_VARIABLE})",
    )
    evaluate.add_argument(
        "--backend", choices=BACKENDS, help="measure over this backend only: stop if the server names another"
    )
    evaluate.add_argument("--until-idle", action="store_true", help="end as soon as nothing waits")

    check = commands.add_parser("check", help="whether a server would take payloads of any client")
    check.add_argument("files", nargs="+", type=Path, metavar="FILE", help="a submission as JSON")
    check.add_argument("--server", required=True, **address)
    check.add_argument("--token", metavar="T", help="of an installation (else one is made and erased)")
    return whole


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be at least 1")
    return value


def _positive_number(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: must be a number above 0")
    return value


def _names(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise argparse.ArgumentTypeError("give at least one name")
    return names


def _ignored(text: str) -> tuple[str, ...]:
    names = _names(text)
    for name in names:
        if name not in IGNORABLE:
            raise argparse.ArgumentTypeError(f"{name}: choose from {', '.join(IGNORABLE)}")
    return names
