"""The version of the rules and of the statistics, stored on every summary and figure."""

# Raise it with any change of a rule or a figure: everything stored is then computed again.
ALGORITHM = 4
# In place of the version that has seen a session: it is to be summarised again.
AGAIN = 0
