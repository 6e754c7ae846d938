"""Tracking the camera: rotation, ICP and brightness over a pyramid of images."""
