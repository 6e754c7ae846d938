"""`python -m client_kit`: measure this device, send the results, export and erase them."""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence

from client_kit import cli_options, interrupts
from client_kit.cli_options import INTERRUPTED, TOKEN_VARIABLE
from client_kit.client import Client
from client_kit.console import Console
from client_kit.delivery import enrolment, sending
from client_kit.delivery.server import Server
from client_kit.delivery.spool import QUEUED, Item
from client_kit.errors import CannotMeasureError, ClientError, UsageError
from groundwork import terminal

NOT_CONFORMING = 1


def main(arguments: Sequence[str] | None = None, prog: str = "python -m client_kit") -> int:
    """Carry out one command as the program `prog`.

    The exit code is 0 when all is sent or safely stored, else as in ClientError.
    Ctrl-C, which ends `evaluate`, gives INTERRUPTED; so does a signal of the system to end.
    """
    options = cli_options.parser(prog).parse_args(arguments)
    console = Console()
    interrupts.as_ctrl_c()
    try:
        return COMMANDS[options.command](options, console) or 0
    except ClientError as error:
        terminal.fail(str(error))
        return error.exit_code
    except ImportError as error:
        from client_kit.device import drivers

        terminal.fail(drivers.remedy(error))
        return CannotMeasureError.exit_code
    except KeyboardInterrupt:
        terminal.note(options.when_stopped)
        return INTERRUPTED


def _run(options: argparse.Namespace, console: Console) -> None:
    ignored = options.ignore + (("battery",) if options.ignore_battery else ())
    Client(options.server, console=console).run(
        agree=options.yes,
        sessions=options.sessions,
        configurations=options.configurations,
        device=options.device,
        ignore=ignored,
        show_model=options.show_model,
        application=options.application,
        backend=options.backend,
        probes=options.probes,
        compiling_minutes=options.compiling_minutes,
    )


def _doctor(_options: argparse.Namespace, console: Console) -> None:
    from client_kit.device.doctor import examine

    console.lines(examine(Client().home))


def _status(_options: argparse.Namespace, console: Console) -> None:
    client = Client()
    items = client.status()
    if not items:
        console.say("Nothing was measured here yet.")
    now = time.time()
    for item in items:
        console.say(_status_line(item, now))
    for enrolled in enrolment.all_enrolments(client.home):
        state = "to be erased" if enrolled.erase else "known there"
        console.say(f"{enrolled.server}: {state} as {enrolled.installation_id}")


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
    waiting = sending.waiting(client.spool)
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
    what = "everything that was measured" if options.run is None else f"run {options.run}"
    if not options.yes:
        if not console.can_ask:
            raise UsageError("no terminal to ask: add --yes to erase")
        if not console.ask(f"Erase {what}, here and on the servers?"):
            console.say("Nothing was erased.")
            return
    if options.run is not None:
        console.lines(f"Erased at {url}." for url in client.erase_run(options.run))
        console.say(f"Nothing of run {sending.run_id(options.run)} is left here.")
    elif not client.erase():
        console.say("The request to erase is stored and sent by the next `run` or `send`.")


def _renew_token(_options: argparse.Namespace, console: Console) -> None:
    if not Client(console=console).renew_tokens():
        console.say("This client has no token: it is not enrolled on any server.")


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
            "low": point.low,
            "high": point.high,
        }
        console.say(json.dumps(document | ({"run": report.to_dict()} if report else {})))
        return
    console.say(f"{point.name} of front {front.application} {front.front_version}")
    interval = ""
    if point.low is not None and point.high is not None:
        interval = f", 95 % interval {1000 * point.low:.2f} to {1000 * point.high:.2f} ms"
    console.say(f"  {1000 * point.runtime:.2f} ms a frame ({point.source}{interval})")
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
    serve(
        Server(options.server),
        options.device,
        options.token,
        Client().home,
        console,
        until_idle=options.until_idle,
        backend=options.backend,
    )


def _check(options: argparse.Namespace, console: Console) -> int:
    from client_kit.delivery.check import check

    verdicts = check(options.files, Server(options.server), Client().home, options.token)
    for verdict in verdicts:
        console.lines(verdict.lines())
    return 0 if all(verdict.conforms for verdict in verdicts) else NOT_CONFORMING


COMMANDS: dict[str, Callable[[argparse.Namespace, Console], int | None]] = {
    "run": _run,
    "doctor": _doctor,
    "status": _status,
    "send": _send,
    "export": _export,
    "erase": _erase,
    "renew-token": _renew_token,
    "choose": _choose,
    "evaluate": _evaluate,
    "check": _check,
}

if __name__ == "__main__":
    sys.exit(main())
