"""The peers of fusion: fusion.py FOLDER gtsam|filterpy.

gtsam: a body's inertial readings and poses as a factor graph (combined factors between poses, biases that walk), by Gauss and Newton's steps; states go to FOLDER/found.f64, a row a pose: quaternion x, y, z, w, position,
velocity, bias of gyroscope and accelerometer, then the 15 deviations. filterpy: a chain of position, rate and acceleration behind an encoder, by its filter and Rauch-Tung-Striebel smoother; a row a reading: means, then variances.

Prints one JSON line: version, seconds by the clock and of the processor. Those of gtsam are of the optimisation, then of the deviations too (marginal covariances of all states): readings are handed over one by one from Python before.
"""

import json
import os
import pathlib
import sys
import time
from importlib.metadata import version

for variable in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "TBB_NUM_THREADS"]:
    os.environ[variable] = "1"

import numpy as np


def read(folder, name, width=1):
    values = np.fromfile(folder / f"{name}.f64")
    return values.reshape(-1, width) if width > 1 else values


def body(folder):
    import gtsam

    times, rates, forces = read(folder, "times"), read(folder, "rates", 3), read(folder, "forces", 3)
    stamps, positions, attitudes = read(folder, "stamps"), read(folder, "positions", 3), read(folder, "attitudes", 4)
    # Densities of gyroscope, accelerometer and their walks, deviations of position and attitude, of the biases at first, gravity.
    gyro, force, gyro_walk, force_walk, position, attitude, gyro_bias, force_bias, gravity = read(folder, "noise")
    parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(gravity)
    parameters.setGyroscopeCovariance(np.eye(3) * gyro**2)
    parameters.setAccelerometerCovariance(np.eye(3) * force**2)
    parameters.setIntegrationCovariance(np.eye(3) * 1e-16)
    parameters.setBiasOmegaCovariance(np.eye(3) * gyro_walk**2)
    parameters.setBiasAccCovariance(np.eye(3) * force_walk**2)
    pose, speed, bias = gtsam.symbol_shorthand.X, gtsam.symbol_shorthand.V, gtsam.symbol_shorthand.B
    graph, first = gtsam.NonlinearFactorGraph(), gtsam.Values()
    seen = gtsam.noiseModel.Diagonal.Sigmas(np.array([attitude] * 3 + [position] * 3))
    zero = gtsam.imuBias.ConstantBias()
    velocities = np.gradient(positions, stamps, axis=0)
    for node in range(len(stamps)):
        x, y, z, w = attitudes[node]
        measured = gtsam.Pose3(gtsam.Rot3.Quaternion(w, x, y, z), positions[node])
        graph.add(gtsam.PriorFactorPose3(pose(node), measured, seen))
        first.insert(pose(node), measured)
        first.insert(speed(node), velocities[node])
        first.insert(bias(node), zero)
    known = np.array([force_bias] * 3 + [gyro_bias] * 3)
    graph.add(gtsam.PriorFactorConstantBias(bias(0), zero, gtsam.noiseModel.Diagonal.Sigmas(known)))
    for node in range(len(stamps) - 1):
        between = gtsam.PreintegratedCombinedMeasurements(parameters, zero)
        low, high = stamps[node], stamps[node + 1]
        cuts = np.concatenate([[low], times[(times > low) & (times < high)], [high]])
        middle = 0.5 * (cuts[:-1] + cuts[1:])
        readings = [np.array([np.interp(middle, times, of[:, k]) for k in range(3)]).T for of in (forces, rates)]
        for a, w, dt in zip(*readings, np.diff(cuts)):
            between.integrateMeasurement(a, w, dt)
        keys = pose(node), speed(node), pose(node + 1), speed(node + 1), bias(node), bias(node + 1)
        graph.add(gtsam.CombinedImuFactor(*keys, between))
    settings = gtsam.GaussNewtonParams()
    settings.setRelativeErrorTol(1e-12)
    settings.setAbsoluteErrorTol(1e-9)
    start, used = time.perf_counter(), time.process_time()
    optimizer = gtsam.GaussNewtonOptimizer(graph, first, settings)
    estimate = optimizer.optimize()
    optimised = time.perf_counter() - start, time.process_time() - used
    marginals = gtsam.Marginals(graph, estimate)
    covariances = [[marginals.marginalCovariance(of(node)) for of in (pose, speed, bias)] for node in range(len(stamps))]
    seconds = time.perf_counter() - start, time.process_time() - used
    rows = []
    for node in range(len(stamps)):
        at, biases = estimate.atPose3(pose(node)), estimate.atConstantBias(bias(node))
        q = at.rotation().toQuaternion()
        parts = [[q.x(), q.y(), q.z(), q.w()], at.translation(), estimate.atVector(speed(node)), biases.gyroscope(), biases.accelerometer()]
        # A pose's error is its turn, then its shift, both in the body; a bias' that of the accelerometer, then of the gyroscope.
        of_pose, of_speed, of_bias = covariances[node]
        turn = at.rotation().matrix()
        blocks = [of_pose[:3, :3], turn @ of_pose[3:, 3:] @ turn.T, of_speed, of_bias[3:, 3:], of_bias[:3, :3]]
        parts += [np.sqrt(np.diag(block)) for block in blocks]
        rows.append(np.concatenate(parts))
    np.array(rows).tofile(folder / "found.f64")
    return version("gtsam"), optimised + seconds, optimizer.iterations()


def joint(folder):
    from filterpy.kalman import KalmanFilter

    values, (dt, noise, jerk) = read(folder, "values"), read(folder, "noise")
    chain = KalmanFilter(dim_x=3, dim_z=1)
    chain.F = np.array([[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1]])
    chain.Q = jerk**2 * np.array([
        [dt**5 / 20, dt**4 / 8, dt**3 / 6],
        [dt**4 / 8, dt**3 / 3, dt**2 / 2],
        [dt**3 / 6, dt**2 / 2, dt],
    ])
    chain.H, chain.R = np.array([[1.0, 0, 0]]), np.array([[noise**2]])
    chain.x, chain.P = np.zeros((3, 1)), np.diag([1e2, 1e4, 1e6])
    start, used = time.perf_counter(), time.process_time()
    means, covariances, _, _ = chain.batch_filter(values)
    means, covariances, _, _ = chain.rts_smoother(means, covariances)
    seconds = time.perf_counter() - start, time.process_time() - used
    rows = np.concatenate([means[:, :, 0], covariances[:, range(3), range(3)]], axis=1)
    rows.tofile(folder / "found.f64")
    return version("filterpy"), seconds, 1


def main():
    folder, peer = pathlib.Path(sys.argv[1]), sys.argv[2]
    of, seconds, steps = {"gtsam": body, "filterpy": joint}[peer](folder)
    print(json.dumps({"version": of, "seconds": seconds[::2], "processor": seconds[1::2], "steps": steps}))


main()
