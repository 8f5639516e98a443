"""What measures: sensors in the engine and sensors in Python, and the attributes they read."""

from libmpm._src.moved import forward

__getattr__ = forward("sensors")  # names of version 0.1
