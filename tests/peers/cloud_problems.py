"""Makes the obstacles of planning problems into point clouds, as a depth camera would show them from all sides.

10,000 points on the surface of every obstacle, of which one in every cube of 2 cm within the arm's reach is kept, with a ball of
1 cm around it: as VAMP was measured among points on the same problems.

    python tests/peers/cloud_problems.py PROBLEMS.json clouds.json
    lpr plan --robot ARM.urdf --srdf ARM.srdf --problems clouds.json --repeats 7 --simplify

numpy 2. Problems whose goal is within a centimetre of something are invalid among the points.
"""

import json
import sys

import numpy as np

POINTS = 10_000
CUBE = 0.02
POINT_RADIUS = 0.01
SHOULDER, REACH = [0, 0, 0.333], 1.3


def placed(local, solid):
    x, y, z, w = solid["rotation_xyzw"]
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return local @ rotation.T + solid["center"]


def directions(rng):
    normal = rng.normal(size=(POINTS, 3))
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def on_sphere(sphere, rng):
    return np.array(sphere["center"]) + sphere["radius"] * directions(rng)


def on_cuboid(cuboid, rng):
    half = np.array(cuboid["half_extents"])
    areas = half.prod() / half
    axis = rng.choice(3, POINTS, p=areas / areas.sum())
    unit = rng.uniform(-1, 1, (POINTS, 3))
    unit[np.arange(POINTS), axis] = np.sign(unit[np.arange(POINTS), axis])
    return placed(unit * half, cuboid)


def on_capsule(capsule, rng):
    a, b = np.array(capsule["a"]), np.array(capsule["b"])
    return a + np.outer(rng.uniform(0, 1, POINTS), b - a) + capsule["radius"] * directions(rng)


def on_cylinder(cylinder, rng):
    radius, half = cylinder["radius"], cylinder["half_length"]
    areas = np.array([4 * half, radius, radius])
    part = rng.choice(3, POINTS, p=areas / areas.sum())
    angle = rng.uniform(0, 2 * np.pi, POINTS)
    away = np.where(part == 0, radius, radius * np.sqrt(rng.uniform(0, 1, POINTS)))
    height = np.choose(part, [rng.uniform(-half, half, POINTS), half, -half])
    return placed(np.stack([away * np.cos(angle), away * np.sin(angle), height], axis=1), cylinder)


SURFACES = {"spheres": on_sphere, "cuboids": on_cuboid, "capsules": on_capsule, "cylinders": on_cylinder}


def cloud(problem, rng):
    points = [surface(solid, rng) for kind, surface in SURFACES.items() for solid in problem.get(kind, [])]
    points = np.concatenate([*points, np.empty((0, 3))])
    points = points[np.linalg.norm(points - SHOULDER, axis=1) < REACH]
    _, first = np.unique(np.floor(points / CUBE).astype(int), axis=0, return_index=True)
    return points[np.sort(first)]


def main(problems, clouds):
    rng = np.random.default_rng(0)
    with open(problems, encoding="utf-8") as file:
        given = json.load(file)
    made = []
    for problem in given["problems"]:
        points = np.round(cloud(problem, rng), 4).tolist()
        ends = {key: problem[key] for key in ("name", "start", "goals")}
        made.append({**ends, "points": points, "point_radius": POINT_RADIUS})
    with open(clouds, "w", encoding="utf-8") as file:
        json.dump({"robot": given["robot"], "problems": made}, file)
    counts = [len(problem["points"]) for problem in made]
    print(f"{len(made)} problems, {np.median(counts):.0f} points median, {max(counts)} at most")


if __name__ == "__main__":
    main(*sys.argv[1:])
