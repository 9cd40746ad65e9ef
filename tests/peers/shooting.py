"""Least squares of simulations by scipy: the Van der Pol oscillator through segments of a recording.

    shooting.py ROWS STEPS PERIOD

ROWS has lines `x y`. Segments of STEPS steps begin at row 1 and follow each other; x' = y, y' = a x + b y + c x^2 y. Prints a, b, c and the sum of squares.
"""

import sys

import numpy as np
from scipy.optimize import least_squares

rows = np.loadtxt(sys.argv[1])
steps, period = int(sys.argv[2]), float(sys.argv[3])
starts = np.arange(1, len(rows) - steps, steps)
measured = np.stack([rows[start + 1 : start + steps + 1] for start in starts])


def slope(state, theta):
    x, y = state.T
    return np.stack([y, theta[0] * x + theta[1] * y + theta[2] * x * x * y], axis=1)


def residuals(theta):
    state, states = rows[starts], []
    for _ in range(steps):
        one = slope(state, theta)
        two = slope(state + 0.5 * period * one, theta)
        three = slope(state + 0.5 * period * two, theta)
        four = slope(state + period * three, theta)
        state = state + period / 6.0 * (one + 2.0 * two + 2.0 * three + four)
        states.append(state)
    return ((measured - np.stack(states, axis=1)) / np.sqrt(steps)).ravel()


best = least_squares(residuals, [-0.9, 0.8, -0.8], method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
for number in [*best.x, 2.0 * best.cost]:
    print(repr(float(number)))
