"""Errors of attitudes by scipy's rotations.

    rotations.py ROLLOUTS LOG

ROLLOUTS is a table of simulated quaternions `q.w` to `q.z` by episode row and step, LOG the recording, quaternions of any sign. Prints, for every step from 1,
the root mean square and the mean of the angles between the two, rad.
"""

import csv
import sys

import numpy as np
from scipy.spatial.transform import Rotation


def read(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def rotations(rows):
    # scipy has the scalar last.
    return Rotation.from_quat([[float(row[f"q.{part}"]) for part in "xyzw"] for row in rows])


simulated, log = read(sys.argv[1]), read(sys.argv[2])
recorded = rotations([log[int(row["row"])] for row in simulated])
angles = (rotations(simulated).inv() * recorded).magnitude()
steps = np.array([int(row["step"]) for row in simulated])
for step in range(1, steps.max() + 1):
    errors = angles[steps == step]
    print(repr(float(np.sqrt(np.mean(errors**2)))), repr(float(np.mean(errors))))
