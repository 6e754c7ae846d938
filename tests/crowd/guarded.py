"""What a database refuses by itself, past all models."""

import pytest
from django.db import IntegrityError, connection, transaction


def refused_by_the_database(statement: str) -> None:
    with pytest.raises(IntegrityError), transaction.atomic(), connection.cursor() as cursor:
        cursor.execute(statement)
