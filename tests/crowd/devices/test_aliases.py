"""Two names of one device: proposed by rules, decided by people, undone without a trace."""

from typing import Any

import pytest
from django.contrib.auth.models import Permission, User
from django.test import Client
from django.urls import reverse
from hypothesis import given
from hypothesis import strategies as st

from crowd.devices.aliases import candidates, decisions
from crowd.devices.aliases.proposals import Candidate, propose
from crowd.devices.models import DeviceAlias, DeviceDescription, DeviceModel, DeviceSplit
from crowd.devices.recognition import renormalise
from crowd.results.figures import reassigning
from crowd.results.figures import sessions as session_figures
from crowd.results.models import DeviceSpeedup, MeasurementSession
from tests.builders.crowds import Join, crowd
from tests.builders.documents import device_document
from tests.crowd.recognised import described


def phone(key: int, name: str, **changes: Any) -> Candidate:
    members: dict[str, Any] = {"manufacturer": "Samsung", "name": name, "handheld": True} | changes
    return Candidate(key=key, **members)


def pairs(*candidates: Candidate) -> list[tuple[int, int]]:
    return [(found.alias, found.model) for found in propose(candidates)]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"name": "REDMI NOTE 3"}, {"name": "Redmi_Note-3"}),
        ({"name": "LG-H870", "manufacturer": "LG"}, {"name": "H870", "manufacturer": "LG"}),
        ({"name": "SM-G960F", "market_name": "Galaxy S9"}, {"name": "Galaxy S9"}),
        ({"name": "SM-N9005", "devices": frozenset({"hltexx"})}, {"name": "hltexx"}),
        ({"name": "SM-G935F", "soc": "Exynos 8890"}, {"name": "SM-G935FD", "soc": "Exynos 8890"}),
        ({"name": "EVA-L09", "soc": "Kirin 955"}, {"name": "EVA-L19", "soc": "Kirin 955"}),
    ],
)
def test_two_names_of_one_device_are_proposed_once(first: dict[str, Any], second: dict[str, Any]) -> None:
    assert len(propose([phone(1, **first), phone(2, **second)])) == 1


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"name": "Galaxy S9"}, {"name": "Galaxy S9", "manufacturer": "Acme"}),
        ({"name": "Galaxy S9", "manufacturer": ""}, {"name": "galaxy-s9", "manufacturer": ""}),
        ({"name": "Galaxy S9"}, {"name": "Galaxy S9+"}),
        ({"name": "SM-G935F", "soc": "Exynos 8890"}, {"name": "SM-G935A", "soc": "Snapdragon 820"}),
        ({"name": "SM-G935F"}, {"name": "SM-G935A"}),
        ({"name": "Redmi Note 3", "soc": "MT6795"}, {"name": "REDMI NOTE 3", "soc": "MSM8956"}),
        (
            {"name": "XPS 15, Intel Core i7", "cpu": "Intel Core i7", "handheld": False},
            {"name": "XPS-15, Intel Core i7", "cpu": "Intel Core i5", "handheld": False},
        ),
    ],
)
def test_two_devices_are_not_proposed_as_one(first: dict[str, Any], second: dict[str, Any]) -> None:
    assert propose([phone(1, **first), phone(2, **second)]) == []


def test_the_name_that_the_catalogue_knows_stays() -> None:
    assert pairs(phone(1, "galaxy s9"), phone(2, "SM-G960F", market_name="Galaxy S9")) == [(1, 2)]


NAMES = st.sampled_from(["Galaxy S9", "galaxy-s9", "SM-G960F", "SM-G960U", "LG-H870", "H870", "starlte"])


@given(
    st.lists(
        st.builds(
            Candidate,
            key=st.integers(0, 10**6),
            manufacturer=st.sampled_from(["Samsung", "SAMSUNG", "LG", "Acme", ""]),
            name=NAMES,
            market_name=NAMES | st.just(""),
            soc=st.sampled_from(["", "A", "B"]),
            handheld=st.booleans(),
            devices=st.frozensets(NAMES, max_size=2),
        ),
        max_size=12,
        unique_by=lambda one: one.key,
    )
)
def test_nothing_is_proposed_across_makers_or_chips(candidates: list[Candidate]) -> None:
    by_key = {one.key: one for one in candidates}
    for found in propose(candidates):
        alias, model = by_key[found.alias], by_key[found.model]
        assert alias.manufacturer.casefold() == model.manufacturer.casefold() != ""
        assert not (alias.soc and model.soc) or alias.soc == model.soc


@pytest.fixture
def two(front: Any, join: Join) -> tuple[DeviceModel, DeviceModel]:
    """One phone under two names, measured once each: 4 and 16 times faster."""
    crowd(join, {"Pixel 8": 4.0, "PIXEL-8": 16.0})
    return DeviceModel.objects.get(name="Pixel 8"), DeviceModel.objects.get(name="PIXEL-8")


def figures() -> list[tuple[str, float, int]]:
    """Slug, speedup and installations of every figure, once what waited is done."""
    reassigning.reassign_sessions(reassigning.changed_models())
    session_figures.summarise_waiting()
    rows = DeviceSpeedup.objects.select_related("device").order_by("device__slug")
    return [(row.device.slug, round(row.speedup, 6), row.installations) for row in rows]


@pytest.mark.slow
def test_figures_follow_a_merge_and_its_undoing(two: tuple[DeviceModel, DeviceModel]) -> None:
    model, alias = two
    before = figures()
    assert [row[1:] for row in before] == [(4.0, 1), (16.0, 1)]

    decided = decisions.merge([alias], model, "eve")[0]
    merged = figures()

    assert merged == [(model.slug, 8.0, 2)]
    assert (decided.decided_by, decided.state) == ("eve", "accepted")

    decisions.undo(decided, "ada")

    assert figures() == before
    decided.refresh_from_db()
    assert (decided.undone_by, decided.state, decided.decided_by) == ("ada", "undone", "eve")


@pytest.mark.slow
def test_a_proposal_waits_for_a_person(two: tuple[DeviceModel, DeviceModel]) -> None:
    model, alias = two

    assert decisions.propose_aliases() == 1
    assert decisions.propose_aliases() == 0
    proposal = DeviceAlias.objects.get()
    assert (proposal.alias_id, proposal.model_id) == (alias.pk, model.pk)
    assert len(figures()) == 2

    decisions.decide(proposal, "eve", DeviceAlias.State.REFUSED)
    DeviceModel.objects.update(examined=False)

    assert decisions.propose_aliases() == 0
    assert len(figures()) == 2


@pytest.mark.slow
def test_one_look_takes_a_bounded_number_of_new_models(db: None) -> None:
    for number in range(1, 6):
        described(device_document(f"Pixel {number}"))
        described(device_document(f"PIXEL-{number}"))

    first = decisions.propose_aliases(limit=4)

    assert (first, DeviceModel.objects.filter(examined=False).count()) == (2, 6)
    assert [decisions.propose_aliases(limit=4) for _ in range(3)] == [2, 1, 0]


def test_a_new_model_is_compared_with_what_shares_a_token_alone(db: None) -> None:
    """However many models a maker has, those that cannot be the new one are not read."""
    for number in range(30):
        described(device_document(f"SM-A{number:03}F", manufacturer="Samsung", soc_model=None))
    alike = described(device_document("SM-G935A", manufacturer="Samsung", soc_model="Tensor")).model
    old = described(device_document("hltexx", manufacturer="Samsung", soc_model="Tensor")).model
    decisions.propose_all_aliases()
    new = described(
        device_document("SM-G935F", manufacturer="Samsung", soc_model="Tensor", device="hltexx")
    ).model

    compared = candidates.partners(candidates.candidates([new]))

    assert {model.pk for model in compared} == {alike.pk, old.pk, new.pk}
    assert decisions.propose_aliases() == 2


def test_the_same_device_name_finds_an_older_model(db: None) -> None:
    older = described(device_document("SM-N9005", manufacturer="Samsung", device="hltexx")).model
    decisions.propose_all_aliases()
    newer = described(device_document("hltexx", manufacturer="Samsung")).model

    assert decisions.propose_aliases() == 1
    proposal = DeviceAlias.objects.get()
    assert {proposal.alias_id, proposal.model_id} == {older.pk, newer.pk}


def test_two_products_with_one_processor_are_not_proposed_as_one() -> None:
    product = {"name": "AMD EPYC", "cpu": "AMD EPYC", "manufacturer": "Dell", "handheld": False}

    assert propose([phone(1, **product), phone(2, **product)]) == []


def test_merges_of_merges_come_apart_in_any_order(db: None) -> None:
    names = ("Pixel 8", "Pixel_8", "PIXEL-8")
    first, second, third = (described(device_document(name)).model for name in names)
    inner = decisions.merge([first], second, "eve")[0]
    outer = decisions.merge([second], third, "eve")[0]
    assert set(third.members.all()) == {first, second}

    decisions.undo(outer, "eve")

    assert set(second.members.all()) == {first}
    assert not third.members.exists()
    decisions.undo(inner, "eve")
    assert not DeviceModel.objects.exclude(canonical=None).exists()


def test_models_never_merge_across_makers(db: None) -> None:
    ours = described(device_document("One")).model
    theirs = described(device_document("One", manufacturer="Acme")).model

    with pytest.raises(decisions.DecisionError, match="never merge across makers"):
        decisions.merge([theirs], ours, "eve")

    assert not DeviceAlias.objects.exists()


def test_a_circle_is_refused(db: None) -> None:
    first, second = (described(device_document(name)).model for name in ("A 1", "A-1"))
    decisions.merge([first], second, "eve")

    with pytest.raises(decisions.DecisionError, match="undo that first"):
        decisions.merge([second], first, "eve")


def test_figures_follow_a_split_and_its_undoing(front: Any, join: Join) -> None:
    """One code on two chips, which the rules cannot tell apart."""
    for soc, speedup in (("Tensor G3", 4.0), ("Tensor G4", 16.0)):
        crowd(join, {"Pixel 8": speedup}, soc_model=soc)
    before = figures()
    assert [row[1:] for row in before] == [(8.0, 2)]
    other = next(row for row in DeviceDescription.objects.all() if row.raw["soc_model"] == "Tensor G4")

    decision = decisions.split([other], "eve")

    assert sorted(row[1:] for row in figures()) == [(4.0, 1), (16.0, 1)]
    assert decision.model.name == "Pixel 8, Google Tensor G4"

    decisions.undo_split(decision, "ada")

    assert figures() == before
    assert DeviceSplit.objects.get().undone_by == "ada"


def test_a_split_outlives_better_rules(db: None) -> None:
    described(device_document())
    other = described(device_document(soc_model="Tensor G4"))
    decision = decisions.split([other], "eve")

    renormalise(DeviceDescription.objects.all())

    other.refresh_from_db()
    assert other.model_id == decision.model_id


def test_a_split_leaves_something_behind(db: None) -> None:
    only = described(device_document())

    with pytest.raises(decisions.DecisionError, match="leave at least one"):
        decisions.split([only], "eve")


@pytest.fixture
def administration(db: None, client: Client) -> Client:
    """Somebody who may look at devices and decide about models."""
    user = User.objects.create_user("eve", is_staff=True)
    user.user_permissions.set(Permission.objects.filter(content_type__app_label="devices"))
    client.force_login(user)
    return client


def act(client: Client, model: str, action: str, *keys: int) -> str:
    """Run an action of the administration's list of `model`; the page that follows."""
    chosen = {"action": action, "_selected_action": [str(key) for key in keys]}
    response = client.post(reverse(f"admin:devices_{model}_changelist"), chosen, follow=True)
    assert response.status_code == 200
    return response.content.decode()


@pytest.mark.slow
def test_an_administrator_merges_and_undoes(
    two: tuple[DeviceModel, DeviceModel], administration: Client
) -> None:
    model, alias = two

    assert "1 merged into" in act(administration, "devicemodel", "merge", model.pk, alias.pk)
    decided = DeviceAlias.objects.get()
    assert (decided.model_id, decided.decided_by) == (model.pk, "eve")
    assert len(figures()) == 1

    assert "undone" in act(administration, "devicealias", "undo", decided.pk)
    assert len(figures()) == 2


def test_an_administrator_reviews_proposals(
    two: tuple[DeviceModel, DeviceModel], administration: Client
) -> None:
    decisions.propose_aliases()
    proposal = DeviceAlias.objects.get()

    act(administration, "devicealias", "accept", proposal.pk)

    assert len(figures()) == 1
    assert "only a proposal can be refused" in act(administration, "devicealias", "refuse", proposal.pk)


def test_the_queues_hold_what_nobody_looked_at(administration: Client) -> None:
    described({"os": "Android", "manufacturer": "ALPS", "model": "E5533"})
    model = DeviceModel.objects.get(kind=DeviceModel.Kind.UNKNOWN)
    queue = reverse("admin:devices_devicemodel_changelist") + "?queue=unknown"
    assert "E5533" in administration.get(queue).content.decode()

    act(administration, "devicemodel", "is_device", model.pk)

    assert "E5533" not in administration.get(queue).content.decode()
    model.refresh_from_db()
    assert (model.kind, model.judged_by) == ("device", "eve")

    act(administration, "devicemodel", "reset_kind", model.pk)
    model.refresh_from_db()
    assert (model.kind, model.judged_by) == ("unknown", "")


def test_who_may_only_look_decides_nothing(client: Client, two: tuple[DeviceModel, DeviceModel]) -> None:
    user = User.objects.create_user("ada", is_staff=True)
    user.user_permissions.set(Permission.objects.filter(codename__in=["view_devicemodel"]))
    client.force_login(user)

    act(client, "devicemodel", "merge", *(model.pk for model in two))

    assert not DeviceAlias.objects.exists()
    assert MeasurementSession.objects.filter(device=two[1]).exists()
