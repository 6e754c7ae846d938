"""Shared by dense SLAM systems: images on the device, their pyramids, point-to-plane rows, motions."""
