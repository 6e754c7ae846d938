"""Predicting one device from others."""
