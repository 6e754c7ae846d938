"""Read-only admin pages: raw data stays as people sent it, derived data is computed."""

import json
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from django.contrib import admin
from django.contrib.admin.options import BaseModelAdmin
from django.contrib.admin.utils import flatten_fieldsets
from django.core.exceptions import FieldDoesNotExist
from django.db.models import JSONField, Model
from django.http import HttpRequest
from django.utils.safestring import SafeString
from django.utils.text import capfirst

from crowd.administration.json_tables import as_html


class JsonTables(BaseModelAdmin):  # type: ignore[type-arg]  # not generic at run time
    """Shows JSON fields as tables in read-only forms.

    `json_texts` names text fields that hold JSON.
    """

    json_texts: tuple[str, ...] = ()

    def get_fieldsets(self, request: HttpRequest, obj: Any = None) -> Any:
        """Django's fieldsets, with a table in place of each JSON field."""
        return [
            (title, {**options, "fields": self.as_tables(options["fields"])})
            for title, options in super().get_fieldsets(request, obj)
        ]

    def as_tables(self, fields: Sequence[Any]) -> list[Any]:
        """`fields` of a fieldset, with a table in place of each JSON field."""
        return [
            self.as_tables(field) if isinstance(field, list | tuple) else self._as_table(field)
            for field in fields
        ]

    def _as_table(self, name: Any) -> Any:
        try:
            field = self.opts.get_field(name)
        except (FieldDoesNotExist, TypeError):
            return name
        label = str(getattr(field, "verbose_name", name))
        if name in self.json_texts:
            return _table_of(name, label, json.loads)
        return _table_of(name, label) if isinstance(field, JSONField) else name


def _identity(value: Any) -> Any:
    return value


@cache  # Django compares fields that are functions: one field needs one function
def _table_of(name: str, label: str, read: Callable[[Any], Any] = _identity) -> Callable[[Model], SafeString]:
    """A display function, as Django's admin needs it, for the JSON field `name`."""

    def table(row: Model) -> SafeString:
        return as_html(read(getattr(row, name)))

    table.__name__ = name  # Django finds the field's help text by it
    table.short_description = capfirst(label)  # type: ignore[attr-defined]
    return table


class ReadOnlyAdmin(JsonTables, admin.ModelAdmin):  # type: ignore[type-arg]  # not generic at run time
    """Lists and shows rows; nothing can be changed."""

    list_per_page = 50
    show_full_result_count = False

    def has_add_permission(self, request: HttpRequest) -> bool:  # noqa: ARG002
        return False

    def has_change_permission(self, request: HttpRequest, obj: Any = None) -> bool:  # noqa: ARG002
        return False

    def has_delete_permission(self, request: HttpRequest, obj: Any = None) -> bool:  # noqa: ARG002
        return False


class ReadOnlyInline(JsonTables, admin.TabularInline):  # type: ignore[type-arg]  # not generic at run time
    """Shows the rows of a parent; nothing can be changed."""

    template = "admin/readonly_rows.html"
    extra = 0
    can_delete = False
    show_change_link = True

    def get_readonly_fields(self, request: HttpRequest, obj: Any = None) -> Any:
        """Every field of the fieldsets."""
        return flatten_fieldsets(self.get_fieldsets(request, obj))

    def has_add_permission(self, request: HttpRequest, obj: Any = None) -> bool:  # noqa: ARG002
        return False

    def has_change_permission(self, request: HttpRequest, obj: Any = None) -> bool:  # noqa: ARG002
        return False
