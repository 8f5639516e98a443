"""Attacks on libmpm: kills, broken and forged files, full disks, hostile messages.

``python -m tests.attack --minutes 5 --seed 0`` runs all of them for a while and says what it found;
`docs/reliability.md` has the results. Every case follows from the attack, a seed and a number, so a
later call with the same seed goes on where the last one stopped. A case that shows a defect is kept
in a folder, and ``--replay FOLDER`` runs it again.
"""
