"""`python -m client_kit`: measure this device, send what was measured, see and erase what was sent."""

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from client_kit import __version__, delivery, enrolment, interrupts
from client_kit.client import Client
from client_kit.console import Console
from client_kit.errors import CannotMeasureError, ClientError, UsageError
from client_kit.manifest import ALL
from client_kit.preflight import IGNORABLE
from client_kit.server import Server
from client_kit.spool import QUEUED, Item
from slam.protocol import VALID_BELOW

INTERRUPTED = 130
NOT_CONFORMING = 1
TOKEN_VARIABLE = "FRONTRUNNER_DEVICE_TOKEN"


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command; the exit code is 0 when all is sent or safely kept, else as in ClientError.

    Ctrl-C, by which `evaluate` ends, is INTERRUPTED; so is being told to end by the system.
    """
    options = _parser().parse_args(arguments)
    console = Console()
    interrupts.as_ctrl_c()
    try:
        return options.command(options, console) or 0
    except ClientError as error:
        print(f"frontrunner: {error}", file=sys.stderr)
        return error.exit_code
    except ImportError as error:
        from client_kit import drivers

        print(f"frontrunner: {drivers.remedy(error)}", file=sys.stderr)
        return CannotMeasureError.exit_code
    except KeyboardInterrupt:
        print(f"frontrunner: {options.when_stopped}", file=sys.stderr)
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m client_kit",
        description="Measure how fast dense SLAM runs on this device, by the published Pareto front.",
        epilog="Exit codes: 0 sent or safely kept, 1 a payload does not conform (check), 2 usage, 3 cannot "
        f"measure here, 4 too old, {INTERRUPTED} ended by Ctrl-C.",
    )
    parser.set_defaults(when_stopped="stopped")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    address: dict[str, Any] = {"metavar": "URL", "help": "address of the Frontrunner server"}
    opencl: dict[str, Any] = {"metavar": "TEXT", "help": "the OpenCL device whose name contains this"}

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
    run.add_argument("--device", **opencl)
    run.add_argument(
        "--minutes",
        type=_number,
        metavar="M",
        help="repeat for so long at most, until the figures are certain (as the server asks; 0: never)",
    )
    run.add_argument(
        "--ignore",
        type=_ignored,
        default=(),
        metavar="NAMES",
        help=f"measure in spite of these: {', '.join(IGNORABLE)}",
    )
    run.add_argument("--ignore-battery", action="store_true", help="as --ignore battery")
    shown = run.add_mutually_exclusive_group()
    shown.add_argument(
        "--show-model",
        action="store_true",
        default=None,
        help="show this device's model in public though few people measured it",
    )
    shown.add_argument("--hide-model", dest="show_model", action="store_false", help="no longer show it")
    kept = "stopped; finished runs and sessions are kept and go with the next `send`"
    run.set_defaults(command=_run, when_stopped=kept)

    doctor = commands.add_parser("doctor", help="whether this device can measure, and what it would tell")
    doctor.set_defaults(command=_doctor)

    status = commands.add_parser("status", help="what was measured here and what became of it")
    status.set_defaults(command=_status)

    send = commands.add_parser("send", help="send what is still on this device")
    send.add_argument("--wait", action="store_true", help="go on, with pauses, until all is sent")
    send.set_defaults(command=_send, when_stopped=kept)

    export = commands.add_parser("export", help="everything kept here and on the servers, as JSON")
    export.add_argument("--out", type=Path, metavar="FILE", help="write to a file instead of standard output")
    export.set_defaults(command=_export)

    erase = commands.add_parser("erase", help="erase what was sent and what is kept here")
    erase.add_argument(
        "--run", metavar="ID", help="this run alone, by its id in `export` or its page's address"
    )
    erase.set_defaults(command=_erase)

    renew = commands.add_parser(
        "renew-token", help="replace the tokens by which the servers know this client"
    )
    renew.set_defaults(command=_renew_token)

    choose = commands.add_parser("choose", help="the configuration to run on this device")
    choose.add_argument(
        "--max-ate", type=_positive_number, default=VALID_BELOW, metavar="M", help="metres (0.05)"
    )
    choose.add_argument("--max-ms", type=_positive_number, metavar="T", help="milliseconds a frame")
    choose.add_argument("--server", metavar="URL", help="whose front, when several were visited")
    choose.add_argument("--application", help="of which, when several were measured", metavar="NAME")
    choose.add_argument("--device", **opencl)
    choose.add_argument("--json", action="store_true", help="print JSON")
    choose.add_argument("--run", type=Path, metavar="SEQUENCE", help="run it over this sequence")
    choose.add_argument("--frames", type=_positive, metavar="N", help="of that sequence (all)")
    choose.set_defaults(command=_choose)

    evaluate = commands.add_parser(
        "evaluate", help="serve as a reference device: measure what the server's explorations ask for"
    )
    evaluate.add_argument("--server", required=True, **address)
    evaluate.add_argument("--device", required=True, metavar="NAME", help="the reference device's name there")
    evaluate.add_argument(
        "--token",
        default=os.environ.get(TOKEN_VARIABLE),
        metavar="T",
        help=f"its token, which an administrator issues (else from {TOKEN_VARIABLE})",
    )
    evaluate.add_argument("--until-idle", action="store_true", help="end as soon as nothing waits")
    evaluate.set_defaults(command=_evaluate)

    check = commands.add_parser("check", help="whether a server would take payloads of any client")
    check.add_argument("files", nargs="+", type=Path, metavar="FILE", help="a submission as JSON")
    check.add_argument("--server", required=True, **address)
    check.add_argument("--token", metavar="T", help="of an installation (else one is made and erased)")
    check.set_defaults(command=_check)
    return parser


def _run(options: argparse.Namespace, console: Console) -> None:
    ignored = options.ignore + (("battery",) if options.ignore_battery else ())
    Client(options.server, console=console).run(
        agree=options.yes,
        sessions=options.sessions,
        configurations=options.configurations,
        device=options.device,
        ignore=ignored,
        minutes=options.minutes,
        show_model=options.show_model,
        application=options.application,
    )


def _doctor(_options: argparse.Namespace, console: Console) -> None:
    from client_kit.doctor import examine

    console.lines(examine(Client().home))


def _status(_options: argparse.Namespace, console: Console) -> None:
    client = Client()
    items = client.status()
    if not items:
        console.say("Nothing was measured here yet.")
    now = time.time()
    for item in items:
        console.say(_status_line(item, now))
    for known in enrolment.known(client.home):
        state = "to be erased" if known.erase else "known there"
        console.say(f"{known.server}: {state} as {known.installation_id}")


def _status_line(item: Item, now: float) -> str:
    when = time.strftime("%Y-%m-%d %H:%M", time.localtime(item.created))
    words = [item.id[:8], when, item.state, item.server]
    if item.attempts:
        words.append(f"attempts {item.attempts}")
    if item.reason:
        words.append(f"({item.reason})")
    if item.state == QUEUED and item.asked_to_wait and not item.due(now, eager=True):
        words.append(f"next in {item.not_before - now:.0f} s, as the server asks")
    return "  ".join(words)


def _send(options: argparse.Namespace, console: Console) -> None:
    client = Client(console=console)
    client.send(wait=options.wait)
    waiting = delivery.waiting(client.spool)
    console.say(f"{len(waiting)} still to send." if waiting else "Nothing is left to send.")


def _export(options: argparse.Namespace, console: Console) -> None:
    text = json.dumps(Client().export(), indent=2, ensure_ascii=False)
    if options.out is None:
        console.say(text)
        return
    try:
        options.out.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--out {options.out} cannot be written: {error.strerror}") from error


def _erase(options: argparse.Namespace, console: Console) -> None:
    client = Client(console=console)
    if options.run is not None:
        console.lines(f"Erased at {url}." for url in client.erase_run(options.run))
        console.say(f"Nothing of run {delivery.run_id(options.run)} is left here.")
    elif not client.erase():
        console.say("The request to erase is kept and goes with the next `run` or `send`.")


def _renew_token(_options: argparse.Namespace, console: Console) -> None:
    if not Client(console=console).renew_tokens():
        console.say("No server knows this client: there is no token to replace.")


def _choose(options: argparse.Namespace, console: Console) -> None:
    client = Client(options.server)
    front = client.front(options.application)
    point = client.choose(options.max_ate, options.max_ms, options.device, front.application)
    report = None
    if options.run is not None:
        from client_kit import adaptation

        device = client.chosen_device(options.device)
        report = adaptation.run(point, front.application, options.run, device, options.frames)
    if options.json:
        document = {
            "front_version": front.front_version,
            "configuration": point.name,
            "parameters": point.parameters,
            "runtime": point.runtime,
            "ate_max": point.ate_max,
            "source": point.source,
        }
        console.say(json.dumps(document | ({"run": report.to_dict()} if report else {})))
        return
    console.say(f"{point.name} of front {front.application} {front.front_version}")
    console.say(f"  {1000 * point.runtime:.2f} ms a frame ({point.source})")
    console.say(f"  largest trajectory error {100 * point.ate_max:.2f} cm")
    for name, value in point.parameters.items():
        console.say(f"  {name} = {value}")
    if report is not None:
        limit = None if options.max_ms is None else options.max_ms / 1000
        console.lines(adaptation.lines(report, options.max_ate, limit))


def _evaluate(options: argparse.Namespace, console: Console) -> None:
    from client_kit.evaluation import serve

    if not options.token:
        raise UsageError(f"--token is missing: an administrator issues one ({TOKEN_VARIABLE} works too)")
    home = Client().home
    serve(Server(options.server), options.device, options.token, home, console, options.until_idle)


def _check(options: argparse.Namespace, console: Console) -> int:
    from client_kit.check import check

    verdicts = check(options.files, Server(options.server), Client().home, options.token)
    for verdict in verdicts:
        console.lines(verdict.lines())
    return 0 if all(verdict.conforms for verdict in verdicts) else NOT_CONFORMING


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be at least 1")
    return value


def _number(text: str) -> float:
    value = float(text)
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: must be a number, 0 or more")
    return value


def _positive_number(text: str) -> float:
    value = _number(text)
    if value == 0:
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


if __name__ == "__main__":
    sys.exit(main())
