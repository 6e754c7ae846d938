"""The intake of submissions as Django REST framework's own documentation would have one write it.

The peer of `python -m tests.benchmarks.crowd`: the same documents, tokens, checks of types and lengths,
idempotent keys and unique runs, in one transaction a request, by ModelSerializers with nested writes. It
makes no summaries and tells no worker.
"""
