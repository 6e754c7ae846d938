"""The command `frontrunner`: one door to the client, the search, SLAM and the server."""

__version__ = "0.2.0"
