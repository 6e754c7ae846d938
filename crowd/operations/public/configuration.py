"""Checks of the settings."""

from collections.abc import Iterator
from pathlib import Path

from django.conf import settings
from django.core import checks

from crowd.operations.public.check_result import CheckResult, passed, to_do

LEAST_QUORUM, LEAST_NAMED = 3, 5


def run() -> Iterator[CheckResult]:
    """Check all settings."""
    yield _hosts()
    yield _https()
    yield _debug()
    yield _secret_key()
    yield _deployment()
    yield _operator()
    yield _limits()
    yield _proxies()
    yield _disclosure()


def _hosts() -> CheckResult:
    title, hosts = "Host names", settings.PUBLIC_HOSTS
    if not hosts:
        remedy = "set FRONTRUNNER_HOSTS to the server's names"
        return to_do(title, "only this machine can reach the server", remedy)
    if any("*" in host for host in hosts):
        remedy = "set FRONTRUNNER_HOSTS to the names themselves, without *"
        return to_do(title, f"{', '.join(hosts)} answers for any name", remedy)
    return passed(title, f"reached as {', '.join(hosts)}")


def _https() -> CheckResult:
    if settings.HTTPS:
        return passed("HTTPS", "the server redirects to HTTPS and sends secure cookies only")
    remedy = (
        "put a proxy with a certificate in front (deploy/ has two) and remove FRONTRUNNER_HTTPS=0: "
        "FRONTRUNNER_HOSTS switches HTTPS on"
    )
    return to_do("HTTPS", "pages and passwords travel unencrypted", remedy)


def _debug() -> CheckResult:
    if settings.DEBUG:
        return to_do("Debug pages", "errors show source and settings to everyone", "set DEBUG=0")
    return passed("Debug pages", "off")


def _secret_key() -> CheckResult:
    title, file = "Secret key", Path(settings.FRONTRUNNER_VAR) / "secret_key"
    if file.exists() and file.read_text().strip() == settings.SECRET_KEY:
        mode = file.stat().st_mode & 0o777
        if mode & 0o077:
            return to_do(title, f"others can read {file} (mode {mode:o})", f"chmod 600 {file}")
        return passed(
            title, "in a file that only its owner can read", "keep a copy separate from the backups"
        )
    return passed(title, "from the environment (FRONTRUNNER_SECRET_KEY)")


def _deployment() -> CheckResult:
    """Django's security checks; its other checks are slow, and meant for developers."""
    messages = checks.run_checks(tags=[checks.Tags.security], include_deployment_checks=True)
    serious = [one for one in messages if one.level >= checks.WARNING and not one.is_silenced()]
    if not serious:
        return passed("Django's checks", "frontrunner admin check --deploy --tag security finds nothing")
    text = "; ".join(f"{one.id}: {one.msg}" for one in serious)
    return to_do("Django's checks", text, "run frontrunner admin check --deploy --tag security and follow it")


def _operator() -> CheckResult:
    wanted = {
        "FRONTRUNNER_OPERATOR": settings.FRONTRUNNER_OPERATOR,
        "FRONTRUNNER_CONTACT": settings.FRONTRUNNER_CONTACT,
    }
    missing = [name for name, value in wanted.items() if not value]
    if missing:
        finding = "participants cannot see who runs the server, or whom to ask"
        remedy = f"set {' and '.join(missing)}; /about/ shows both"
        return to_do("Operator and contact", finding, remedy)
    return passed("Operator and contact", f"{', '.join(wanted.values())} (on /about/)")


def _limits() -> CheckResult:
    if not settings.FRONTRUNNER_READS_PER_MINUTE:
        return to_do("Limits on requests", "there are none", "set FRONTRUNNER_LIMITS to a number above 0")
    return passed("Limits on requests", "they are on")


def _proxies() -> CheckResult:
    title, count = "Proxies", settings.REST_FRAMEWORK["NUM_PROXIES"]
    if settings.HTTPS and not count:
        finding = "all clients share the limits of the proxy's address"
        return to_do(title, finding, "set FRONTRUNNER_PROXIES to the number of proxies in front")
    return passed(title, f"{count} in front of the server (FRONTRUNNER_PROXIES)")


def _disclosure() -> CheckResult:
    title, quorum, named = "Masks", settings.FRONTRUNNER_QUORUM, settings.FRONTRUNNER_RARE_BELOW
    if quorum < LEAST_QUORUM or named < LEAST_NAMED:
        finding = f"a figure is confirmed by {quorum} installations, a model is named from {named} on"
        remedy = (
            f"remove FRONTRUNNER_QUORUM and FRONTRUNNER_RARE_BELOW ({LEAST_QUORUM} and {LEAST_NAMED}): "
            "smaller numbers are for a private server"
        )
        return to_do(title, finding, remedy)
    return passed(title, f"rare models are masked below {named} installations; {quorum} confirm a figure")
