"""The version of the rules and of the statistics, stored on every summary and figure."""

# Raise it with each change of a rule or a figure: everything stored is then computed again.
ALGORITHM = 12
# Stored as the version of a session that must be summarised again.
OUTDATED = 0
