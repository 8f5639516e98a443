"""Implementation of libmpm, one folder a subject; import the public names from `libmpm`."""

from libmpm._src import moved

moved.install()
