"""Thresholds of all figures: what counts as found, right, near. Lengths are shares of an object's
longest side.

Limits of physical checks stand with the checks (``simulation.sweep``, ``simulation.primitives``).
"""

# A part is matched if its box is so near: the largest difference of the corners' coordinates
# (L-infinity); found if its joint type is right, too. Ours (docs/evaluation.md).
FOUND = 0.2

# A part is right if its box, its joint type, its signed axis (degrees) and, where it turns, the
# line of its axis are. Ours (docs/evaluation.md); no published figure of the field has a sign.
RIGHT_BOX = 0.1
RIGHT_AXIS = 10.0
RIGHT_PIVOT = 0.05

# Beyond this angle (degrees) between the ways that two parts open, one opens the wrong way.
WRONG_WAY = 90.0

# F-score: a point is near a surface. Of 65,536 points a surface, two samples of one surface are
# within .01 for .92 of the points, within .02 for all (``evaluation.surface``).
F_SCORE = 0.02
