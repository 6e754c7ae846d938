"""The migrations of `crowd.results`, and one more."""

from crowd.results import migrations

__path__ = [*__path__, *migrations.__path__]
