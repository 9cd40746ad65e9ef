"""The oracle of smoothing and filters: scipy, on rows `t y w` of a text file; one number a line."""

import sys

import numpy as np
from scipy import interpolate, signal


def spline(rows, lam):
    """Values and slopes of the cubic smoothing spline at the stamps."""
    t, y, w = rows
    found = interpolate.make_smoothing_spline(t, y, w=w, lam=float(lam))
    return np.concatenate([found(t), found.derivative()(t)])


def savgol(rows, window, degree, derivative, dt):
    return signal.savgol_filter(rows[1], int(window), int(degree), deriv=int(derivative), delta=float(dt))


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
