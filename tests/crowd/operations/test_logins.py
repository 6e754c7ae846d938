"""The administration's log-in: limits that lock out no known browser, and one-time passwords."""

import time
from typing import Any

import pytest
from django.contrib.auth import get_user_model
from django.core import signing
from django.core.management import CommandError, call_command
from django.test import Client, RequestFactory
from django_otp.oath import TOTP
from django_otp.plugins.otp_totp.models import TOTPDevice

from crowd.access import counters, device_cookies, logins

PASSWORD = "correct horse battery"


@pytest.fixture
def account(db: None) -> Any:
    return get_user_model().objects.create_superuser("root", "", PASSWORD)


def log_in(client: Client, password: str = PASSWORD, user: str = "root", **more: str) -> Any:
    return client.post(
        "/admin/login/?next=/admin/", {"username": user, "password": password, "next": "/admin/"} | more
    )


def inside(client: Client) -> bool:
    return bool(client.get("/admin/").status_code == 200)


def one_time_password(device: TOTPDevice) -> str:
    generator = TOTP(device.bin_key, device.step, device.t0, device.digits, device.drift)
    generator.time = time.time()
    return f"{generator.token():06d}"


def test_name_and_password_are_enough_by_default(client: Client, account: Any) -> None:
    assert log_in(client).status_code == 302
    assert inside(client)


def test_too_many_tries_are_refused_even_with_the_right_password(client: Client, account: Any) -> None:
    for _ in range(logins.TRIES_OF_ADDRESS_AT_ACCOUNT):
        assert log_in(client, "wrong").status_code == 200

    refused = log_in(client)

    assert refused.status_code == 429
    assert 0 < int(refused.headers["Retry-After"]) <= logins.WINDOW_SECONDS
    assert "Too many tries" in refused.content.decode()
    assert not inside(client)


@pytest.mark.slow
def test_tries_from_one_address_lock_no_other_out(account: Any) -> None:
    attacker, owner = Client(REMOTE_ADDR="203.0.113.9"), Client(REMOTE_ADDR="198.51.100.1")
    for _ in range(logins.TRIES_AT_ACCOUNT + 1):
        log_in(attacker, "wrong")

    assert log_in(owner).status_code == 302


def attacked_from_everywhere() -> None:
    """As many tries as one account allows, each from another network."""
    for number in range(logins.TRIES_AT_ACCOUNT):
        request = RequestFactory(REMOTE_ADDR=f"203.0.{number}.7").post("/admin/login/")
        logins.seconds_to_wait(request, "root")


def test_many_networks_at_one_account_are_refused(account: Any) -> None:
    attacked_from_everywhere()

    assert log_in(Client(REMOTE_ADDR="198.51.100.1")).status_code == 429


def test_a_browser_that_logged_in_before_is_not_locked_out_by_strangers(account: Any) -> None:
    owner = Client(REMOTE_ADDR="198.51.100.1")
    log_in(owner)
    owner.post("/admin/logout/")
    attacked_from_everywhere()

    owner.defaults["REMOTE_ADDR"] = "192.0.2.44"  # another network on another day
    assert log_in(owner, "wrong").status_code == 200
    assert log_in(owner).status_code == 302
    assert inside(owner)


def test_a_known_browser_has_a_limit_of_its_own(account: Any) -> None:
    owner = Client()
    log_in(owner)
    owner.post("/admin/logout/")
    for _ in range(logins.TRIES_OF_KNOWN_BROWSER):
        assert log_in(owner, "wrong").status_code == 200

    assert log_in(owner).status_code == 429
    assert log_in(Client()).status_code == 302  # its tries are not counted elsewhere


def test_a_browser_is_known_for_the_account_it_logged_in_to_alone(account: Any) -> None:
    get_user_model().objects.create_user("colleague", password=PASSWORD, is_staff=True)
    colleague = Client(REMOTE_ADDR="198.51.100.1")
    log_in(colleague, user="colleague")
    (name,) = (name for name in colleague.cookies if name.startswith("device_"))
    colleague.post("/admin/logout/")
    attacked_from_everywhere()

    assert log_in(colleague).status_code == 429
    theirs = colleague.cookies[name].value
    for guessed in (device_cookies.cookie_name("root"), name):
        forger = Client(REMOTE_ADDR="198.51.100.2", headers={"cookie": f"{guessed}={theirs}"})
        assert log_in(forger).status_code == 429


def test_an_altered_or_old_cookie_makes_no_browser_known(
    account: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    owner = Client(REMOTE_ADDR="198.51.100.1")
    log_in(owner)
    name = device_cookies.cookie_name("root")
    attacked_from_everywhere()
    for value in (
        "",
        "root",
        owner.cookies[name].value[:-1] + "?",
        signing.dumps(["root", "1"], salt="other"),
    ):
        stranger = Client(REMOTE_ADDR="198.51.100.2")
        stranger.cookies[name] = value
        assert log_in(stranger).status_code == 429

    monkeypatch.setattr(device_cookies, "LIFETIME_SECONDS", -1)
    assert log_in(owner).status_code == 429


def test_the_cookie_is_out_of_reach_for_scripts_and_other_sites(account: Any, settings: Any) -> None:
    settings.SESSION_COOKIE_SECURE = True
    owner = Client()

    log_in(owner)

    cookie = owner.cookies[device_cookies.cookie_name("root")]
    assert (cookie["httponly"], cookie["secure"], cookie["samesite"]) == (True, True, "Strict")
    assert cookie["path"] == "/admin/"
    assert "root" not in cookie.key
    assert not [name for name in Client().get("/admin/login/").cookies if name.startswith("device_")]


def test_a_wrong_password_makes_no_browser_known(client: Client, account: Any) -> None:
    log_in(client, "wrong")

    assert device_cookies.cookie_name("root") not in client.cookies


@pytest.mark.slow
@pytest.mark.parametrize(
    ("inside_network", "outside"),
    [
        ([f"203.0.113.{number}" for number in range(1, 8)], "203.0.112.1"),
        ([f"2001:db8:1:{number}::1" for number in range(1, 8)], "2001:db8:2:1::1"),
    ],
)
def test_a_network_has_a_limit_that_spares_the_account(
    account: Any, inside_network: list[str], outside: str
) -> None:
    refused = []
    for number in range(logins.TRIES_OF_NETWORK + 1):
        browser = Client(REMOTE_ADDR=inside_network[number % len(inside_network)])
        refused.append(log_in(browser, "wrong", user=f"user{number}").status_code == 429)

    assert refused == [False] * logins.TRIES_OF_NETWORK + [True]
    assert log_in(Client(REMOTE_ADDR=outside)).status_code == 302


@pytest.mark.parametrize("address", ["127.0.0.1", "::1", "::ffff:127.0.0.1"])
def test_this_machine_itself_is_not_refused_by_the_limit_of_an_account(account: Any, address: str) -> None:
    attacked_from_everywhere()

    assert log_in(Client(REMOTE_ADDR=address)).status_code == 302


def test_a_proxy_on_this_machine_is_not_this_machine(account: Any) -> None:
    attacked_from_everywhere()

    proxied = Client(REMOTE_ADDR="127.0.0.1", headers={"x-forwarded-for": "198.51.100.1"})
    assert log_in(proxied).status_code == 429


def test_an_address_that_tries_many_accounts_is_refused(client: Client, account: Any) -> None:
    for number in range(logins.TRIES_OF_ADDRESS):
        log_in(client, "wrong", user=f"user{number}")

    assert log_in(client).status_code == 429


def test_tries_are_counted_outside_this_process(client: Client, account: Any) -> None:
    for _ in range(logins.TRIES_OF_ADDRESS_AT_ACCOUNT):
        log_in(client, "wrong")
    counters._open_store.cache_clear()
    counters._salt.cache_clear()

    assert log_in(client).status_code == 429


def test_an_account_with_a_device_needs_its_password_of_the_moment(
    client: Client, account: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    call_command("totp", "root")
    assert "otpauth://totp/" in capsys.readouterr().out
    device = TOTPDevice.objects.get()

    assert log_in(client).status_code == 200
    assert log_in(client, otp_token="000000").status_code == 200
    assert not inside(client)
    TOTPDevice.objects.update(throttling_failure_count=0, throttling_failure_timestamp=None)

    assert log_in(client, otp_token=one_time_password(device)).status_code == 302
    assert inside(client)


def test_a_one_time_password_works_once(client: Client, account: Any) -> None:
    call_command("totp", "root")
    password = one_time_password(TOTPDevice.objects.get())
    log_in(client, otp_token=password)

    assert log_in(Client(), otp_token=password).status_code == 200


def test_a_log_in_from_before_the_device_is_not_enough(client: Client, account: Any) -> None:
    log_in(client)
    call_command("totp", "root")

    assert not inside(client)

    call_command("totp", "root", "--remove")
    assert inside(client)


def test_where_all_need_one_nobody_gets_in_without(client: Client, account: Any, settings: Any) -> None:
    settings.FRONTRUNNER_REQUIRE_TOTP = True

    assert log_in(client).status_code == 200
    client.force_login(account)
    assert not inside(client)


def test_one_time_passwords_for_nobody(db: None) -> None:
    with pytest.raises(CommandError, match="no account 'unknown'"):
        call_command("totp", "unknown")


def test_an_administrator_sets_up_anothers_device(client: Client, account: Any) -> None:
    colleague = get_user_model().objects.create_user("colleague", is_staff=True)
    log_in(client)

    page = client.post(
        "/admin/otp_totp/totpdevice/add/", {"user": colleague.pk, "name": "phone"}, follow=True
    ).content.decode()

    device = TOTPDevice.objects.get(user=colleague)
    assert "otpauth://totp/" in page
    later = client.get(f"/admin/otp_totp/totpdevice/{device.pk}/change/").content.decode()
    assert device.key not in later
    assert client.get(f"/admin/otp_totp/totpdevice/{device.pk}/config/").status_code == 403
