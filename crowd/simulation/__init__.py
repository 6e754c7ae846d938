"""Fills a demo server: plausible devices and a search, whose measurements go through the real API."""
