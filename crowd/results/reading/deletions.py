"""How many runs participants deleted one by one, while they kept the others."""

from crowd.results.models import Tombstone


def single_deletions() -> int:
    """Runs that a participant deleted alone, and not together with everything else. One query over an index.

    Anyone who deletes chosen runs can move a figure. The count says how often that may have happened.
    """
    return Tombstone.objects.filter(single=True).count()
