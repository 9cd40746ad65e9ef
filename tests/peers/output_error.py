"""Output error and filter error by scipy: parameters, gains and initial states of given equations, noise and minimum in turn.

    output_error.py [--filter] SYSTEM ROWS PERIOD LENGTH START...

SYSTEM names the equations below; ROWS is a file of numbers, one row a line: states, then inputs. Every LENGTH rows begin an episode. Prints the parameters,
with --filter the gain of every output, the deviations of the noise (of the innovations), and the seconds that the fit took, one number a line. The seconds are those of `least_squares` with differences of all unknowns in one
vectorised simulation; a last fit with derivatives by complex steps, which is not timed, gives the digits.
"""

import sys
import time

import numpy as np
from scipy.optimize import least_squares

GAIN = 35.15065188


def van_der_pol(x, u, p):
    return x[1], p[0] * (1 - x[0] * x[0]) * x[1] - p[1] * x[0]


def short_period(x, u, p):
    return p[0] * x[0] + x[1] + p[1] * u[0], p[2] * x[0] + p[3] * x[1] + p[4] * u[0]


def emps(x, u, p):
    return x[1], (GAIN * u[0] - p[1] * x[1] - p[2] * np.tanh(x[1] / 0.01) - p[3]) / p[0]


SYSTEMS = {"van_der_pol": (van_der_pol, 2, [0, 1]), "short_period": (short_period, 2, [0, 1]), "emps": (emps, 2, [0])}


class Problem:
    def __init__(self, system, rows, period, length, filtered):
        self.slope, states, self.outputs = SYSTEMS[system]
        cut = [rows[at:at + length] for at in range(0, len(rows), length)]
        self.measured = [part[:, :states] for part in cut]
        self.inputs = [part[:, states:] for part in cut]
        self.period, self.states, self.filtered = period, states, filtered

    def simulate(self, beginning, u, p, gains, measured):
        """Runge-Kutta steps with held inputs, from states that gains move towards what was measured; `beginning`, `p` and `gains` may be batches, their last axis."""
        h, x, out = self.period, beginning, [beginning]
        for k in range(len(u) - 1):
            if len(gains):
                x = np.array(x)
                for gain, output in zip(gains, self.outputs):
                    x[output] = x[output] + gain * (measured[k, output] - x[output])
            one = np.array(self.slope(x, u[k], p))
            two = np.array(self.slope(x + 0.5 * h * one, u[k], p))
            three = np.array(self.slope(x + 0.5 * h * two, u[k], p))
            four = np.array(self.slope(x + h * three, u[k], p))
            x = x + h / 6 * (one + 2 * two + 2 * three + four)
            out.append(x)
        return np.array(out)

    def errors(self, z, count):
        """Measured less simulated, rows x outputs x batch, of all episodes."""
        gains, parts = len(self.outputs) if self.filtered else 0, []
        p, gains = z[:count - gains], z[count - gains:count]
        for at, (measured, u) in enumerate(zip(self.measured, self.inputs)):
            beginning = z[count + at * self.states:count + (at + 1) * self.states]
            path = self.simulate(beginning, u, p, gains, measured)[:, self.outputs]
            parts.append((measured[:, self.outputs, None] if path.ndim == 3 else measured[:, self.outputs]) - path)
        return np.concatenate(parts)

    def fit(self, z, count, sigma, exact):
        def residuals(z):
            return (self.errors(z, count) / sigma).ravel()

        def jacobian(z):
            if exact:
                # A complex step: derivatives to the last digits.
                moved = z[:, None] + 1e-30j * np.eye(len(z))
                return (self.errors(moved, count).imag / 1e-30 / sigma[:, None]).reshape(-1, len(z))
            size = np.finfo(float).eps ** 0.5 * np.maximum(1, np.abs(z))
            moved = np.column_stack([z[:, None] + np.diag(size), z])
            values = (self.errors(moved, count) / sigma[:, None]).reshape(-1, len(z) + 1)
            return (values[:, :-1] - values[:, -1:]) / size

        z = least_squares(residuals, z, jac=jacobian, method="lm", x_scale="jac", xtol=1e-10, ftol=1e-10, gtol=1e-10).x
        # MINPACK ends where costs are equal up to rounding, eight digits before the parameters are: Gauss-Newton steps find the others.
        for _ in range(20 if exact else 0):
            J = jacobian(z)
            length = np.linalg.norm(J, axis=0)
            step = np.linalg.lstsq(J / length, -residuals(z), rcond=None)[0] / length
            z = z + step
            if np.abs(step / z).max() < 1e-13:
                break
        return z


def main():
    filtered = sys.argv[1] == "--filter"
    system, file, period, length, *start = sys.argv[1 + filtered:]
    problem = Problem(system, np.loadtxt(file, ndmin=2), float(period), int(length), filtered)
    start = np.array([float(value) for value in start] + [0.5] * len(problem.outputs) * filtered)
    count = len(start)
    begun = time.perf_counter()
    z = np.concatenate([start] + [measured[0] for measured in problem.measured])
    sigma = np.std(np.concatenate(problem.measured)[:, problem.outputs], axis=0)
    for exact in (False, True):
        for _ in range(50):
            z = problem.fit(z, count, sigma, exact)
            now = np.sqrt(np.mean(problem.errors(z, count) ** 2, axis=0))
            change = np.abs(now / sigma - 1).max()
            sigma = now
            if change < (1e-11 if exact else 1e-6):
                break
        if not exact:
            seconds = time.perf_counter() - begun
    for value in [*z[:count], *sigma, seconds]:
        print(repr(float(value)))


main()
