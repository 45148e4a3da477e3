"""Writes tests/golden/fk_{xarm7,panda}.json: flange poses of random configurations.

An implementation independent of lpr-core: 4x4 matrices from URDF joint origins (xyz, roll), not DH rows and quaternions.
Needs numpy==2.3.5. Run from the repository's root: python tests/peers/kinematics.py
"""

import json
from math import pi
from pathlib import Path

import numpy as np

N_POSES = 1000
SEED = 20240607

# Origin of each joint in its parent (metres), roll of that origin in quarter turns, limits (rad); every axis is z.
XARM7 = [
    ((0, 0, 0.267), 0, -2 * pi, 2 * pi),
    ((0, 0, 0), -1, -2.059, 2.0944),
    ((0, -0.293, 0), 1, -2 * pi, 2 * pi),
    ((0.0525, 0, 0), 1, -0.19198, 3.927),
    ((0.0775, -0.3425, 0), 1, -2 * pi, 2 * pi),
    ((0, 0, 0), 1, -1.69297, pi),
    ((0.076, 0.097, 0), -1, -2 * pi, 2 * pi),
]
PANDA = [
    ((0, 0, 0.333), 0, -2.8973, 2.8973),
    ((0, 0, 0), -1, -1.7628, 1.7628),
    ((0, -0.316, 0), 1, -2.8973, 2.8973),
    ((0.0825, 0, 0), 1, -3.0718, -0.0698),
    ((-0.0825, 0.384, 0), -1, -2.8973, 2.8973),
    ((0, 0, 0), 1, -0.0175, 3.7525),
    ((0.088, 0, 0), 1, -2.8973, 2.8973),
]
ROBOTS = {"xarm7": (XARM7, 0.0), "panda": (PANDA, 0.107)}


def origin(xyz, quarter_turns):
    """Parent-from-joint at angle zero."""
    sine = float(quarter_turns)
    cosine = 1.0 - abs(sine)
    transform = np.eye(4)
    transform[1:3, 1:3] = [[cosine, -sine], [sine, cosine]]
    transform[:3, 3] = xyz
    return transform


def turn(angle):
    """Rotation about z."""
    transform = np.eye(4)
    transform[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return transform


def quaternion(rotation):
    """xyzw with w >= 0: the eigenvector of Bar-Itzhack's matrix with the largest eigenvalue."""
    m = rotation
    k = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
            [0, m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [0, 0, m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [0, 0, 0, m[0, 0] + m[1, 1] + m[2, 2]],
        ]
    )
    xyzw = np.linalg.eigh(k, UPLO="U")[1][:, -1]
    return xyzw if xyzw[3] >= 0 else -xyzw


def pose(joints, flange, angles):
    transform = np.eye(4)
    for (xyz, quarter_turns, _, _), angle in zip(joints, angles):
        transform = transform @ origin(xyz, quarter_turns) @ turn(angle)
    transform = transform @ origin((0, 0, flange), 0)
    return transform[:3, 3], quaternion(transform[:3, :3])


def rounded(values):
    return [round(float(value), 9) for value in values]


def main():
    golden = Path(__file__).parent.parent / "golden"
    for name, (joints, flange) in ROBOTS.items():
        rng = np.random.default_rng(SEED)
        lower, upper = np.array([joint[2:] for joint in joints]).T
        lines = []
        for _ in range(N_POSES):
            # As f32, which the angles are in lpr-core.
            angles = rng.uniform(lower, upper).astype(np.float32)
            position, rotation = pose(joints, flange, angles.astype(np.float64))
            record = {"q": rounded(angles), "position": rounded(position), "rotation_xyzw": rounded(rotation)}
            lines.append(json.dumps(record, separators=(",", ":")))
        (golden / f"fk_{name}.json").write_text("[\n" + ",\n".join(lines) + "\n]\n")


if __name__ == "__main__":
    main()
