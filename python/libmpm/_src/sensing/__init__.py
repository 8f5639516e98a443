"""Sensors that are evaluated in Python at the step boundaries where they fall due."""
