"""Where the camera is: rotation, ICP and brightness over a pyramid of images."""
