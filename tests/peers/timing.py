"""Writes tests/golden/toppra.json: how long toppra takes along random paths of a Panda.

The same curve as lpr-core's, a natural cubic spline over the chord length, on a grid so fine that its choice does not matter.
Needs toppra==0.6.3 and numpy==2.4.6. Run from the repository's root: python tests/peers/timing.py
"""

import json
from pathlib import Path

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint

SEED = 20261122
N_PATHS = 40
N_INTERVALS = 3000

LOWER = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
UPPER = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])


def scattered(rng, n):
    """Configurations anywhere within the limits: long ways and sharp turns."""
    return rng.uniform(LOWER, UPPER, (n, 7))


def wandering(rng, n):
    """A walk of short steps that turn slowly, as planners' paths do."""
    waypoints = [rng.uniform(0.5 * LOWER + 0.5 * UPPER, UPPER)]
    step = rng.normal(0, 0.1, 7)
    for _ in range(n - 1):
        step = 0.7 * step + rng.normal(0, 0.07, 7)
        waypoints.append(np.clip(waypoints[-1] + step, LOWER, UPPER))
    return np.array(waypoints)


def duration(waypoints):
    chords = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    at = np.concatenate([[0], np.cumsum(chords)])
    path = toppra.SplineInterpolator(at, waypoints, bc_type="natural")
    # Knots are grid points, as they are in lpr-core.
    pieces = [np.linspace(a, b, max(2, round(N_INTERVALS * (b - a) / at[-1])), endpoint=False) for a, b in zip(at, at[1:])]
    grid = np.concatenate([*pieces, [at[-1]]])
    limits = [
        toppra.constraint.JointVelocityConstraint(np.stack([-VELOCITY, VELOCITY], axis=1)),
        toppra.constraint.JointAccelerationConstraint(np.stack([-ACCELERATION, ACCELERATION], axis=1)),
    ]
    instance = toppra.algorithm.TOPPRA(limits, path, gridpoints=grid, solver_wrapper="seidel")
    return float(instance.compute_trajectory(0, 0).duration)


def main():
    rng = np.random.default_rng(SEED)
    lines = []
    for idx in range(N_PATHS):
        n = int(rng.integers(2, 51)) if idx >= 4 else [2, 3, 50, 50][idx]
        make = scattered if idx % 2 else wandering
        # As f32, which the angles are in lpr-core.
        waypoints = make(rng, n).round(4).astype(np.float32)
        record = {"waypoints": [[round(float(q), 4) for q in row] for row in waypoints]}
        record["duration_secs"] = round(duration(waypoints.astype(np.float64)), 6)
        lines.append(json.dumps(record, separators=(",", ":")))
    limits = {"velocity": VELOCITY.tolist(), "acceleration": ACCELERATION.tolist()}
    text = '{"limits":' + json.dumps(limits) + ',\n"paths":[\n' + ",\n".join(lines) + "\n]}\n"
    (Path(__file__).parent.parent / "golden" / "toppra.json").write_text(text)


if __name__ == "__main__":
    main()
