"""Plans of 16 arms as their makers describe them, checked on their meshes.

    make robots
    tests/peers/.venv/bin/python tests/peers/arms_on_meshes.py LPR [NAME...]

Every arm is loaded without an SRDF; what it needs to be told (tip) is in ARMS. Five boxes stand around
it. Of configurations that are free on the meshes by coal, pairs become problems; the first 20 whose
ends the program finds free, too, and that some planner solves in a minute have to be solved. Each path
is looked at 64 times per radian on the meshes, without the pairs of links that the program says it
leaves out: nothing may be deeper than 2 mm. The depth in a mesh is that in its convex hull, of the
deepest vertex of the other.
"""

import json
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

N_PLANS = 20
N_CONFIGS = 120
PER_RADIAN = 64
DEEPEST = 0.002
SECONDS = 60
SHARE = Path(sys.prefix) / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"
SHARE = SHARE / "cmeel.prefix" / "share"
ROBOTS = SHARE / "example-robot-data" / "robots"

# File and tip; none where there is only one.
ARMS = {
    "ur3": ("ur_description/urdf/ur3_robot.urdf", "tool0"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "ur5_gripper": ("ur_description/urdf/ur5_gripper.urdf", "tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand_tcp"),
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "tiago_no_hand": ("tiago_description/robots/tiago_no_hand.urdf", "wrist_ft_tool_link"),
    "pr2": ("pr2_description/urdf/pr2.urdf", "r_gripper_tool_frame"),
    "baxter": ("baxter_description/urdf/baxter.urdf", "right_gripper"),
    "talos_left_arm": ("talos_data/robots/talos_left_arm.urdf", "arm_left_7_link"),
    "so100": ("so_arm_description/urdf/so100.urdf", "gripper"),
    "so101": ("so_arm_description/urdf/so101.urdf", "gripper_link"),
    "z1": ("z1_description/urdf/z1.urdf", "gripperStator"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", None),
    "g1": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "right_rubber_hand"),
    "romeo": ("romeo_description/urdf/romeo.urdf", "r_wrist"),
}


def run(command, timeout=None):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=timeout)
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip())
    return done


class Arm:
    """An arm in pinocchio, with five boxes, and what the program says of it."""

    def __init__(self, lpr, path, tip, folder, rng):
        self.options = ["--robot", path] + (["--tip", tip] if tip else [])
        srdf = Path(folder) / "found.srdf"
        describe = [lpr, "robots", "--describe", path, "--json", "--write-srdf", srdf]
        start = time.time()
        self.described = json.loads(run(describe + self.options[2:]).stdout)
        self.seconds = time.time() - start
        self.model = pin.buildModelFromUrdf(str(path))
        self.data = self.model.createData()
        self.geometry = pin.buildGeomFromUrdf(self.model, str(path), pin.COLLISION, package_dirs=[str(SHARE)])
        self.n_robot = len(self.geometry.geometryObjects)
        self.by_name = {joint["name"]: joint for joint in self.described["joints"]}
        self.allowed = {
            frozenset((it.get("link1"), it.get("link2")))
            for it in ET.parse(srdf).getroot().findall("disable_collisions")
        }
        self.boxes = self.add_boxes(rng)
        self.add_pairs()
        self.geometry_data = self.geometry.createData()

    def link(self, idx):
        return self.model.frames[self.geometry.geometryObjects[idx].parentFrame].name

    def q(self, config):
        """A configuration of the model; what is not in the chain stands at 0 moved into its limits."""
        driven = dict(zip(self.by_name, config))
        followers = {it["name"]: it for it in self.described["followers"]}
        q = pin.neutral(self.model)
        for idx, name in enumerate(self.model.names):
            if idx == 0:
                continue
            at = self.model.idx_qs[idx]
            if name in driven:
                value = driven[name]
            elif name in followers:
                it = followers[name]
                value = it["multiplier"] * driven[it["joint"]] + it["offset"]
            elif self.model.nqs[idx] == 1:
                value = np.clip(0.0, self.model.lowerPositionLimit[at], self.model.upperPositionLimit[at])
            else:
                value = 0.0
            if self.model.nqs[idx] == 2:
                q[at : at + 2] = np.cos(value), np.sin(value)
            else:
                q[at] = value
        return q

    def moves(self, idx):
        """True if a joint of the chain, or what follows one, carries it."""
        joint = self.geometry.geometryObjects[idx].parentJoint
        moving = set(self.by_name) | {it["name"] for it in self.described["followers"]}
        while joint:
            if self.model.names[joint] in moving:
                return True
            joint = self.model.parents[joint]
        return False

    def add_boxes(self, rng):
        """Five boxes in the world, which is the frame of the root link, at heights that the arm reaches."""
        reach = self.described["reach"]["radius"]
        pin.forwardKinematics(self.model, self.data, self.q([0.0] * len(self.by_name)))
        first = self.model.getJointId(next(iter(self.by_name)))
        middle = self.data.oMi[first].translation
        boxes = []
        for i in range(5):
            away, turn = reach * rng.uniform(0.35, 0.75), rng.uniform(-np.pi, np.pi)
            center = middle + [away * np.cos(turn), away * np.sin(turn), reach * rng.uniform(-0.2, 0.6)]
            half = reach * rng.uniform(0.04, 0.12, 3)
            rotation = pin.Quaternion(pin.exp3(rng.uniform(-1.5, 1.5, 3)))
            placement = pin.SE3(rotation, center)
            shape = coal.Box(*(2.0 * half))
            self.geometry.addGeometryObject(pin.GeometryObject(f"box{i}", 0, 0, placement, shape))
            boxes.append(
                {
                    "center": center.tolist(),
                    "rotation_xyzw": rotation.coeffs().tolist(),
                    "half_extents": half.tolist(),
                }
            )
        return boxes

    def add_pairs(self):
        for a in range(self.n_robot):
            for b in range(a + 1, len(self.geometry.geometryObjects)):
                if b >= self.n_robot:
                    if self.moves(a):
                        self.geometry.addCollisionPair(pin.CollisionPair(a, b))
                    continue
                same = self.geometry.geometryObjects[a].parentJoint == self.geometry.geometryObjects[b].parentJoint
                if same or frozenset((self.link(a), self.link(b))) in self.allowed:
                    continue
                if self.moves(a) or self.moves(b):
                    self.geometry.addCollisionPair(pin.CollisionPair(a, b))

    def hits(self, config):
        """The pairs that touch, none if free."""
        q = self.q(config)
        if not pin.computeCollisions(self.model, self.data, self.geometry, self.geometry_data, q, False):
            return []
        pairs = zip(self.geometry.collisionPairs, self.geometry_data.collisionResults)
        return [(pair.first, pair.second) for pair, result in pairs if result.isCollision()]

    def depth(self, pair):
        """Depth of the deepest vertex of one geometry in the other, metres, at the last configuration."""
        return max(self.one_way(*pair), self.one_way(*pair[::-1]))

    def one_way(self, a, b):
        shape, solid = (self.geometry.geometryObjects[idx].geometry for idx in (a, b))
        place_a, place_b = (self.geometry_data.oMg[idx] for idx in (a, b))
        if isinstance(solid, coal.BVHModelBase):
            solid = convex_hull(solid)
        points = vertices(shape)
        deepest = 0.0
        ball = coal.Sphere(1e-9)
        for point in points:
            at = place_a.act(point)
            request, result = coal.DistanceRequest(True), coal.DistanceResult()
            here = coal.Transform3s(np.eye(3), at)
            there = coal.Transform3s(place_b.rotation, place_b.translation)
            deepest = max(deepest, -coal.distance(ball, here, solid, there, request, result))
        return deepest


def convex_hull(mesh):
    mesh.buildConvexRepresentation(False)
    return mesh.convex


def vertices(shape):
    if isinstance(shape, coal.BVHModelBase):
        return [shape.vertices(i) for i in range(shape.num_vertices)]
    points = []
    if isinstance(shape, coal.Box):
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
        return list(signs * shape.halfSide)
    if isinstance(shape, (coal.Cylinder, coal.Capsule)):
        for turn in np.linspace(0, 2 * np.pi, 64, endpoint=False):
            for z in np.linspace(-shape.halfLength, shape.halfLength, 9):
                points.append([shape.radius * np.cos(turn), shape.radius * np.sin(turn), z])
        return [np.array(point) for point in points]
    if isinstance(shape, coal.Sphere):
        z = 1 - 2 * (np.arange(200) + 0.5) / 200
        turn = np.pi * (1 + 5**0.5) * np.arange(200)
        return list(shape.radius * np.array([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z]).T)
    raise TypeError(type(shape))


def plan(lpr, arm, file, planner):
    """The result of the problem in a file; none after a minute."""
    command = [lpr, "plan", "--problems", file, "--planner", planner, "--simplify", "--json"]
    try:
        return json.loads(run(command + arm.options, timeout=SECONDS).stdout)["results"][0]
    except subprocess.TimeoutExpired:
        return None


def check(lpr, name, rng):
    path, tip = ARMS[name]
    with tempfile.TemporaryDirectory() as folder:
        arm = Arm(lpr, ROBOTS / path, tip, folder, rng)
        bounds = []
        for joint in arm.described["joints"]:
            limits = joint["limits"]
            bounds.append((-np.pi, np.pi) if limits is None or joint["kind"] == "continuous" else limits)
        free, n_drawn = [], 0
        while len(free) < N_CONFIGS and n_drawn < 100 * N_CONFIGS:
            config = [float(np.float32(rng.uniform(*bound))) for bound in bounds]
            n_drawn += 1
            if not arm.hits(config):
                free.append(config)
        solved, missed, n_invalid, n_hard = [], [], 0, 0
        for start, goal in zip(free[::2], free[1::2]):
            problem = {"name": name, "start": start, "goals": [goal], "cuboids": arm.boxes}
            file = Path(folder) / "problem.json"
            file.write_text(json.dumps({"robot": arm.described["name"], "problems": [problem]}))
            result = plan(lpr, arm, file, "rrt-connect")
            if result is not None and result["reason"] in ("start_collides", "goal_collides"):
                n_invalid += 1
            elif result is not None and result["solved"]:
                solved.append(result)
            elif any((it := plan(lpr, arm, file, other)) and it["solved"] for other in ("sbl", "kpiece")):
                missed.append((start, goal))
            else:
                n_hard += 1
            if len(solved) + len(missed) == N_PLANS:
                break
    slowest = max((result["planning_micros"] for result in solved), default=0) * 1e-6
    deepest, what, n_looks = 0.0, "", 0
    for result in solved:
        for a, b in zip(result["path"], result["path"][1:]):
            a, b = np.array(a), np.array(b)
            n = int(np.ceil(np.linalg.norm(b - a) * PER_RADIAN)) + 1
            for fraction in np.linspace(0, 1, n):
                n_looks += 1
                for pair in arm.hits(a + fraction * (b - a)):
                    depth = arm.depth(pair)
                    if depth > deepest:
                        names = [arm.geometry.geometryObjects[idx].name for idx in pair]
                        deepest, what = depth, f" ({names[0]} in {names[1]})"
    overshoot = [link["overshoot"] for link in arm.described["links"] if not link["exact"]]
    print(
        f"{name}: {len(arm.by_name)} joints to {arm.described['tip']}, described in {arm.seconds:.1f} s,"
        f" overshoot {1e3 * max(overshoot, default=0):.0f} mm; {len(free)} of {n_drawn} free on meshes,"
        f" {n_invalid} problems not free as spheres, {n_hard} that no planner solves in {SECONDS} s;"
        f" {len(solved)} solved, {len(missed)} missed, slowest {slowest:.2f} s; {n_looks} looks, deepest {1e3 * deepest:.1f} mm{what}",
        flush=True,
    )
    return len(solved) == N_PLANS and deepest <= DEEPEST


def main():
    lpr, *only = sys.argv[1:]
    names = [name for name in ARMS if not only or name in only]
    passed = 0
    for name in names:
        try:
            passed += check(lpr, name, np.random.default_rng(0))
        except RuntimeError as error:
            print(f"{name}: {error}", flush=True)
    print(f"{passed} of {len(names)} arms pass")
    sys.exit(0 if passed == len(names) else 1)


if __name__ == "__main__":
    main()
