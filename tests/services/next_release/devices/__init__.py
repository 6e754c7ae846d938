"""The migrations of `crowd.devices`, and one more."""

from crowd.devices import migrations

__path__ = [*__path__, *migrations.__path__]
