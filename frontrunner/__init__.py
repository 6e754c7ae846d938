"""The command `frontrunner`: one door to the client, the search, SLAM and the server."""
