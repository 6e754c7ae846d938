"""The intake of submissions as Django REST framework's own documentation would have one write it.

The peer of `python -m tests.benchmarks.crowd`: the same documents, tokens, checks of types and lengths,
idempotent keys and unique runs, in one transaction a request, by ModelSerializers with nested writes, and a
message to a worker for each session. What ours does besides, it leaves: limits, unknown members, devices,
checks of the protocol, judging of runs. The messages of neither are processed.
"""
