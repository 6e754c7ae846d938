"""What dense SLAM systems share: images on the device, their pyramids, point-to-plane rows, motions."""
