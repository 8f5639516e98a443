"""Reference cases with known answers: scenes, measurements and bounds."""
