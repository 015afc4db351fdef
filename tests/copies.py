"""Arrays with other values, by NumPy: each ``x.at[place].set(values)`` would compile programs."""

import numpy as np


def replaced(array, place, values):
    """A copy in which ``values`` are at ``place``."""
    array = np.array(array)
    array[place] = values
    return array


def added(array, place, values):
    """A copy in which ``values`` are added at ``place``."""
    array = np.array(array)
    array[place] += values
    return array
