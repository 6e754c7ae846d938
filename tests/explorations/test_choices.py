"""What a search and a reference device may be set to follows the program, and no migration."""

import pytest
from django.core.exceptions import ValidationError
from django.core.management import call_command

from crowd.explorations import models
from crowd.explorations.models import Exploration, ReferenceDevice
from pareto.search.methods import METHODS
from slam.devices.device import BACKENDS


@pytest.mark.parametrize(("model", "name"), [(Exploration, "method"), (ReferenceDevice, "backend")])
def test_a_new_method_or_backend_needs_no_migration(
    db: None, monkeypatch: pytest.MonkeyPatch, model: type[Exploration | ReferenceDevice], name: str
) -> None:
    monkeypatch.setattr(models, "METHODS", dict(METHODS) | {"toy": METHODS["random"]})
    monkeypatch.setattr(models, "BACKENDS", (*BACKENDS, "toy"))

    call_command("makemigrations", "explorations", check_changes=True, dry_run=True)

    field = model._meta.get_field(name)
    assert field.clean("toy", None) == "toy"
    assert ("toy", "toy") in field.formfield().choices
    with pytest.raises(ValidationError, match="not a valid choice"):
        field.clean("another", None)
