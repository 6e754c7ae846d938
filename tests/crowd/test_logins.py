"""The administration's log-in: counted tries, one-time passwords for who has them or where all need them."""

import time
from typing import Any

import pytest
from django.contrib.auth import get_user_model
from django.core.management import CommandError, call_command
from django.test import Client
from django_otp.oath import TOTP
from django_otp.plugins.otp_totp.models import TOTPDevice

from crowd import counters, logins

PASSWORD = "correct horse battery"


@pytest.fixture
def account(db: None, settings: Any) -> Any:
    # Argon2 is slow on purpose.
    settings.PASSWORD_HASHERS = ["django.contrib.auth.hashers.MD5PasswordHasher"]
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
    for _ in range(logins.TRIES_HERE):
        assert log_in(client, "wrong").status_code == 200

    refused = log_in(client)

    assert refused.status_code == 429
    assert 0 < int(refused.headers["Retry-After"]) <= logins.WINDOW_SECONDS
    assert "Too many tries" in refused.content.decode()
    assert not inside(client)


def test_tries_from_one_address_lock_no_other_out(account: Any) -> None:
    attacker, owner = Client(REMOTE_ADDR="203.0.113.9"), Client(REMOTE_ADDR="198.51.100.1")
    for _ in range(logins.TRIES_AT_ACCOUNT + 1):
        log_in(attacker, "wrong")

    assert log_in(owner).status_code == 302


def test_many_addresses_at_one_account_are_refused(account: Any) -> None:
    for number in range(logins.TRIES_AT_ACCOUNT):
        log_in(Client(REMOTE_ADDR=f"203.0.113.{number}"), "wrong")

    assert log_in(Client(REMOTE_ADDR="198.51.100.1")).status_code == 429


def test_an_address_that_tries_many_accounts_is_refused(client: Client, account: Any) -> None:
    for number in range(logins.TRIES_OF_ADDRESS):
        log_in(client, "wrong", user=f"user{number}")

    assert log_in(client).status_code == 429


def test_tries_are_counted_outside_this_process(client: Client, account: Any) -> None:
    for _ in range(logins.TRIES_HERE):
        log_in(client, "wrong")
    counters._opened.cache_clear()
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
    with pytest.raises(CommandError, match="no account 'nobody'"):
        call_command("totp", "nobody")


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
