"""A configuration that the search proposes a second time."""

from crowd.explorations import services
from crowd.explorations.models import Exploration
from crowd.explorations.outcomes.watching import watch
from crowd.explorations.searching import batches, search
from tests.builders.explorations import finish


def test_a_configuration_measured_again_gets_a_second_result_and_is_counted(exploration: Exploration) -> None:
    finish(services.pending_evaluations(exploration))
    first = services.advance(exploration.pk)
    finish(first)
    again = batches.add_evaluations(exploration, [(first[0].configuration, "again", "")])
    place = first[0].index

    assert place in search.informed_explorer(exploration, search.read_rows(exploration)).history.waiting()
    finish(again)

    explorer = search.informed_explorer(exploration, search.read_rows(exploration))
    assert place is not None
    assert len(explorer.history.results[place]) == 2
    assert place not in explorer.history.waiting()
    seen = watch(exploration.pk)
    assert seen is not None
    assert (seen.searched, seen.phases["again"]) == (5, 1)
