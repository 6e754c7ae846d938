"""`python -m client_kit`: measure this device, send what was measured, see and erase what was sent."""

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from client_kit import __version__, consent, delivery, enrolment
from client_kit.console import Console
from client_kit.errors import ClientError, UsageError
from client_kit.home import Home
from client_kit.manifest import ALL, MAX_ATE_METRES, Manifest, kept_manifests
from client_kit.server import Server, ServerError
from client_kit.spool import QUEUED, Item, Spool

INTERRUPTED = 130
TOKEN_VARIABLE = "FRONTRUNNER_DEVICE_TOKEN"


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command; the exit code is 0 when all is sent or safely kept, else as in ClientError.

    Ctrl-C, by which `evaluate` ends, is INTERRUPTED.
    """
    options = _parser().parse_args(arguments)
    console = Console()
    try:
        options.command(options, Home.of_user(), console)
    except ClientError as error:
        print(f"frontrunner: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"frontrunner: {options.when_stopped}", file=sys.stderr)
        return INTERRUPTED
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m client_kit",
        description="Measure how fast dense SLAM runs on this device, by the published Pareto front.",
        epilog="Exit codes: 0 sent or safely kept, 2 usage, 3 cannot measure here, 4 too old, "
        f"{INTERRUPTED} ended by Ctrl-C.",
    )
    parser.set_defaults(when_stopped="stopped")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="measure a session and send it")
    run.add_argument("--server", required=True, metavar="URL", help="address of the Frontrunner server")
    run.add_argument("--yes", action="store_true", help="agree to the consent text without being asked")
    run.add_argument("--sessions", type=_positive, default=1, metavar="N", help="sessions to measure (1)")
    run.add_argument(
        "--configurations",
        type=_names,
        default=(),
        metavar="NAMES",
        help=f"names of the front, separated by commas; {ALL} is the whole front (as the server asks)",
    )
    run.add_argument("--device", metavar="TEXT", help="the OpenCL device whose name contains this")
    run.add_argument("--ignore-battery", action="store_true", help="measure on a low battery too")
    kept = "stopped; finished sessions are kept and go with the next `send`"
    run.set_defaults(command=_run, when_stopped=kept)

    status = commands.add_parser("status", help="what was measured here and what became of it")
    status.set_defaults(command=_status)

    send = commands.add_parser("send", help="send what is still on this device")
    send.add_argument("--wait", action="store_true", help="go on, with pauses, until all is sent")
    send.set_defaults(command=_send, when_stopped=kept)

    export = commands.add_parser("export", help="everything kept here and on the servers, as JSON")
    export.add_argument("--out", type=Path, metavar="FILE", help="write to a file instead of standard output")
    export.set_defaults(command=_export)

    erase = commands.add_parser("erase", help="erase what was sent and what is kept here")
    erase.set_defaults(command=_erase)

    evaluate = commands.add_parser(
        "evaluate", help="serve as a reference device: measure what the server's explorations ask for"
    )
    evaluate.add_argument("--server", required=True, metavar="URL", help="address of the Frontrunner server")
    evaluate.add_argument("--device", required=True, metavar="NAME", help="the reference device's name there")
    evaluate.add_argument(
        "--token",
        default=os.environ.get(TOKEN_VARIABLE),
        metavar="T",
        help=f"its token, which an administrator issues (else from {TOKEN_VARIABLE})",
    )
    evaluate.add_argument("--until-idle", action="store_true", help="end as soon as nothing waits")
    evaluate.set_defaults(command=_evaluate)

    choose = commands.add_parser("choose", help="the configuration to run on this device")
    choose.add_argument(
        "--max-ate", type=_positive_number, default=MAX_ATE_METRES, metavar="M", help="metres (0.05)"
    )
    choose.add_argument("--max-ms", type=_positive_number, metavar="T", help="milliseconds a frame")
    choose.add_argument("--server", metavar="URL", help="whose front, when several were visited")
    choose.add_argument("--json", action="store_true", help="print JSON")
    choose.set_defaults(command=_choose)
    return parser


def _run(options: argparse.Namespace, home: Home, console: Console) -> None:
    from client_kit.participation import Wishes, run

    wishes = Wishes(
        options.server,
        options.yes,
        options.sessions,
        options.configurations,
        options.device,
        options.ignore_battery,
    )
    run(wishes, home, console)


def _status(_options: argparse.Namespace, home: Home, console: Console) -> None:
    items = Spool(home.spool).items()
    if not items:
        console.say("Nothing was measured here yet.")
    now = time.time()
    for item in items:
        console.say(_status_line(item, now))
    for known in enrolment.known(home):
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


def _send(options: argparse.Namespace, home: Home, console: Console) -> None:
    spool = Spool(home.spool)
    delivered = delivery.deliver(spool, home)
    console.lines(delivered.lines())
    while options.wait and delivered.outdated is None and (waiting := delivery.waiting(spool)):
        now = time.time()
        pause = min(max(item.not_before - now, 1.0) for item in waiting)
        console.say(f"{len(waiting)} to send; next attempt in {pause:.0f} s")
        time.sleep(pause)
        delivered = delivery.deliver(spool, home, eager=False)
        console.lines(delivered.lines())
    if delivered.outdated is not None:
        raise delivered.outdated
    waiting = delivery.waiting(spool)
    console.say(f"{len(waiting)} still to send." if waiting else "Nothing is left to send.")


def _export(options: argparse.Namespace, home: Home, console: Console) -> None:
    spool = Spool(home.spool)
    local = [
        {"state": item.state, "reason": item.reason, "server": item.server, "payload": spool.payload(item)}
        for item in spool.items()
    ]
    remote: dict[str, Any] = {}
    for known in enrolment.known(home):
        try:
            remote[known.server] = Server(known.server).own_data(known.token)
        except ServerError as error:
            remote[known.server] = {"unavailable": str(error)}
    text = json.dumps({"here": local, "servers": remote}, indent=2, ensure_ascii=False)
    if options.out is None:
        console.say(text)
    else:
        try:
            options.out.write_text(text + "\n", encoding="utf-8")
        except OSError as error:
            raise UsageError(f"--out {options.out} cannot be written: {error.strerror}") from error


def _erase(_options: argparse.Namespace, home: Home, console: Console) -> None:
    consent.withdraw(home)
    servers = enrolment.request_erasure(home)
    count = Spool(home.spool).clear()
    console.say(f"Erased {count} sessions here.")
    delivered = delivery.deliver(Spool(home.spool), home)
    console.lines(delivered.lines())
    if len(delivered.erased) < len(servers):
        console.say("The request to erase is kept and goes with the next `run` or `send`.")


def _evaluate(options: argparse.Namespace, home: Home, console: Console) -> None:
    from client_kit.evaluation import serve

    if not options.token:
        raise UsageError(f"--token is missing: an administrator issues one ({TOKEN_VARIABLE} works too)")
    serve(Server(options.server), options.device, options.token, home, console, options.until_idle)


def _choose(options: argparse.Namespace, home: Home, console: Console) -> None:
    from client_kit import choice

    manifest = _front(options.server, home)
    spool = Spool(home.spool)
    payloads = (payload for item in spool.items() if (payload := spool.payload(item)) is not None)
    limit = None if options.max_ms is None else options.max_ms / 1000
    point = choice.choose(choice.points(manifest, payloads), options.max_ate, limit)
    if options.json:
        document = {
            "front_version": manifest.front_version,
            "configuration": point.name,
            "parameters": point.parameters,
            "runtime": point.runtime,
            "ate_max": point.ate_max,
            "source": point.source,
        }
        console.say(json.dumps(document))
        return
    console.say(f"{point.name} of front {manifest.application} {manifest.front_version}")
    console.say(f"  {1000 * point.runtime:.2f} ms a frame ({point.source})")
    console.say(f"  largest trajectory error {100 * point.ate_max:.2f} cm")
    for name, value in point.parameters.items():
        console.say(f"  {name} = {value}")


def _front(server: str | None, home: Home) -> Manifest:
    manifests = kept_manifests(home)
    if server is not None:
        manifests = {url: kept for url, kept in manifests.items() if url == Server(server).url}
    if not manifests:
        raise UsageError("no published front is kept here: run the client against a server first")
    if len(manifests) > 1:
        raise UsageError(f"several servers were visited, add --server: {', '.join(manifests)}")
    return next(iter(manifests.values()))


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


if __name__ == "__main__":
    sys.exit(main())
