"""Helpers shared by the tests: a naive reference method, small scenes and tolerances."""
