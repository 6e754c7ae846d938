"""The names of installations in files that are written again."""

import io
from uuid import UUID, uuid4

import pyarrow as pa
import pyarrow.parquet

from crowd.results.opendata.pseudonyms import PSEUDONYM_LENGTH, EarlierPseudonyms


def sessions(*rows: tuple[UUID, str, int]) -> EarlierPseudonyms:
    """Those of a file with session, installation and group of networks in each of `rows`."""
    columns = ("session", "installation", "network_group")
    file = io.BytesIO()
    lines = [dict(zip(columns, (str(row[0]), *row[1:]), strict=True)) for row in rows]
    pyarrow.parquet.write_table(pa.Table.from_pylist(lines), file)
    file.seek(0)
    return EarlierPseudonyms(file)


def test_a_session_keeps_what_the_earlier_file_calls_its_installation() -> None:
    session = uuid4()
    earlier = sessions((session, "0123456789abcdef", 7))

    assert earlier.installation(session, uuid4()) == "0123456789abcdef"
    assert earlier.group(session, 1, 1, "home") == 7


def test_a_session_that_the_earlier_file_lacks_has_a_new_name_of_the_same_length_and_no_group() -> None:
    earlier = sessions((uuid4(), "0123456789abcdef", 7))
    late = uuid4()

    names = {earlier.installation(late, uuid4()) for _ in range(2)}
    assert {len(name) for name in names} == {PSEUDONYM_LENGTH}
    assert len(names) == 2
    assert earlier.group(late, 1, 1, "home") is None
