"""The oracle of smoothing and filters: scipy, on rows `t y w` of a text file; one number a line."""

import sys
from fractions import Fraction

import numpy as np
from scipy import interpolate, signal


def spline(rows, lam):
    """Values and slopes of the cubic smoothing spline at the stamps."""
    t, y, w = rows
    curve = interpolate.make_smoothing_spline(t, y, w=w, lam=float(lam))
    return np.concatenate([curve(t), curve.derivative()(t)])


def interpolated(curve, t):
    """Value, slope and second derivative at the stamps and three tenths of a step after each, but for the last."""
    at = np.column_stack([t[:-1], 0.7 * t[:-1] + 0.3 * t[1:]]).ravel()
    return np.concatenate([curve(at, k) for k in range(3)])


def not_a_knot(rows):
    return interpolated(interpolate.CubicSpline(*rows[:2], bc_type="not-a-knot"), rows[0])


def pchip(rows):
    return interpolated(interpolate.PchipInterpolator(*rows[:2]), rows[0])


def savgol(rows, window, degree, derivative, dt):
    return signal.savgol_filter(rows[1], int(window), int(degree), deriv=int(derivative), delta=float(dt))


def savgol_exact(rows, window, degree, derivative, dt):
    """The same by rational arithmetic at every row: the polynomial of least squares through its window, or through that at the end of the rows."""
    window, degree, derivative = int(window), int(degree), int(derivative)
    half, y = window // 2, [Fraction(value) for value in rows[1]]
    moments = [sum(Fraction(k) ** power for k in range(-half, half + 1)) for power in range(2 * degree + 1)]
    inverse = solved([[moments[i + j] for j in range(degree + 1)] for i in range(degree + 1)])

    def slope(at):
        """Of the polynomials' powers, derived so often, the values `at` rows from the middle."""
        factor = [Fraction(np.prod(range(power - derivative + 1, power + 1), dtype=object)) for power in range(degree + 1)]
        values = [factor[p] * Fraction(at) ** (p - derivative) if p >= derivative else Fraction(0) for p in range(degree + 1)]
        powers = [sum(values[i] * inverse[i][j] for i in range(degree + 1)) for j in range(degree + 1)]
        return [sum(powers[j] * Fraction(k) ** j for j in range(degree + 1)) for k in range(-half, half + 1)]

    weights = {at: slope(at) for at in range(-half, half + 1)}
    scale, slopes = Fraction(dt) ** derivative, []
    for row in range(len(y)):
        middle = min(max(row, half), len(y) - 1 - half)
        weight = weights[row - middle]
        slopes.append(float(sum(w * v for w, v in zip(weight, y[middle - half : middle + half + 1])) / scale))
    return np.array(slopes)


def solved(matrix):
    """The inverse of a matrix of fractions."""
    size = len(matrix)
    rows = [list(row) + [Fraction(int(i == j)) for j in range(size)] for i, row in enumerate(matrix)]
    for k in range(size):
        pivot = next(i for i in range(k, size) if rows[i][k] != 0)
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i in range(size):
            if i != k:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k])]
    return [row[size:] for row in rows]


def butterworth(rows, order, cutoff, rate):
    sections = signal.butter(int(order), float(cutoff), fs=float(rate), output="sos")
    return signal.sosfiltfilt(sections, rows[1])


def chebyshev(rows, order, ripple, cutoff, rate):
    sections = signal.cheby1(int(order), float(ripple), float(cutoff), fs=float(rate), output="sos")
    return signal.sosfiltfilt(sections, rows[1])


def decimate(rows, factor):
    return signal.decimate(rows[1], int(factor))


if __name__ == "__main__":
    work, path, *arguments = sys.argv[1:]
    answer = globals()[work](np.loadtxt(path, unpack=True), *arguments)
    print("\n".join(repr(float(value)) for value in answer))
